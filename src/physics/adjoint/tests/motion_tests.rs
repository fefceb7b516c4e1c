//! Gradients of motions against central differences of repeated motions.

use super::load_tests::{loaded_quadratic_bar, pressed_bar};
use super::material_tests::{parameters, poisson, quadratic_bar, quantities, stresses};
use super::*;
use crate::Error;
use crate::physics::adjoint::motion::{
    MotionQuantity, MotionResult, MotionTask, gradients_of_motion,
};
use crate::physics::cpu::{StepFailure, StepParts, Steppable};
use crate::physics::{AmplitudeId, Shape, VolumetricFormulation};
use crate::progress::no_progress;
use MotionQuantity::{AtEnd, Integral, Series};

pub(super) const TOLERANCE: f64 = 1e-6;

pub(super) const SCHEMES: [SolverKind; 3] =
    [SolverKind::Implicit, SolverKind::Bdf2, SolverKind::Midpoint];

/// Returns the case moving from a deformed state, in short steps of `kind`.
pub(super) fn moving(mut case: Case, kind: SolverKind) -> Case {
    let long = case.mesh.nodes.iter().map(|p| p.x).fold(0.0, f64::max);
    let state = |p: &DVec3| {
        let (x, y, z) = (p.x / long, p.y / long, p.z / long);
        let offset = DVec3::new(
            0.4 * x * y - 0.2 * x,
            0.3 * x * x,
            0.5 * x * x - 0.2 * x * z,
        );
        let velocity = DVec3::new(x * z, 2.0 * x * x - x, -1.5 * x + x * y);
        [0.01 * offset, 0.2 * velocity]
    };
    let starts = case.mesh.nodes.iter().zip(&case.pinned);
    let starts = starts.map(|(p, pinned)| if *pinned { [DVec3::ZERO; 2] } else { state(p) });
    (case.offsets, case.velocities) = starts.map(|[u, v]| (u, v)).unzip();
    (case.kind, case.dt, case.steps) = (kind, 4e-3, 6);
    case
}

/// Gives the case both kinds of damping.
pub(super) fn damped(mut case: Case) -> Case {
    case.material.damping_time = 4e-3;
    case.material.mass_damping = 3.0;
    case.difference = 0.01;
    case
}

/// Returns the quantities of elements at the end or over time, without those of damped supports.
pub(super) fn of_motion(case: &Case) -> Vec<MotionQuantity> {
    let mut at_end = quantities(case);
    at_end.extend(stresses(case));
    let is_damped = case.material.damping_time > 0.0;
    at_end.retain(|q| !(is_damped && matches!(q, Quantity::PinReaction { .. })));
    let at_end = at_end.into_iter().enumerate();
    at_end
        .map(|(k, q)| if k % 2 == 0 { Integral(q) } else { AtEnd(q) })
        .collect()
}

/// The derivative of the numbers of a series by ½ of the square of the value after a step.
fn weight(step: u32) -> f64 {
    2.0 - 0.3 * f64::from(step)
}

/// Returns two numbers that the values after `steps` steps determine: the last one, and a sum of squares.
fn squares(values: &[f64], steps: u32) -> Option<Vec<(f64, Vec<f64>)>> {
    let all = || values.iter().zip(1..);
    let sum = all().map(|(x, k)| weight(k) * x * x).sum();
    let by = all().map(|(x, k)| 2.0 * weight(k) * x).collect();
    let mut last = vec![0.0; values.len()];
    *last.last_mut()? = 1.0;
    (values.len() as u32 == steps).then(|| vec![(values[values.len() - 1], last), (sum, by)])
}

fn of_start(case: &Case) -> Vec<Parameter> {
    let node = node_at(&case.mesh, DVec3::new(0.08, 0.03, 0.05));
    let direction = DVec3::new(0.5, -0.8, 0.6);
    vec![
        Parameter::InitialPosition { node, direction },
        Parameter::InitialVelocity { node, direction },
    ]
}

/// Returns all parameters of a case without loads and tools.
pub(super) fn of_body(case: &Case) -> Vec<Parameter> {
    let mut all = parameters(case);
    all.extend(poisson(case));
    all.extend(of_start(case));
    let is_damped = case.material.damping_time > 0.0;
    all.retain(|p| !(is_damped && matches!(p, Parameter::RestPosition { .. })));
    if is_damped {
        all.extend([Parameter::DampingTime, Parameter::MassDamping]);
    }
    all
}

impl Case {
    /// Returns the values of quantities of the motion.
    pub(super) fn motion_values(&self, all: &[MotionQuantity]) -> Vec<f64> {
        let at_once: Vec<Quantity> = all.iter().map(|q| q.at_one_time().clone()).collect();
        let mut settled = self.start();
        let mut sums = vec![0.0; all.len()];
        for step in 1..=self.steps {
            if let Some(change) = self.step_loads(&settled.network, step - 1) {
                settled.body.apply_loads(change).unwrap();
            }
            settled.body.run(1, self.dt).unwrap();
            let values = self.values(&settled, &at_once);
            for ((sum, value), quantity) in sums.iter_mut().zip(values).zip(all) {
                match quantity {
                    Integral(_) => *sum += self.dt * value,
                    AtEnd(_) if step == self.steps => *sum = value,
                    AtEnd(_) => {}
                    Series(_) => *sum += weight(step) * value * value,
                }
            }
        }
        sums
    }

    /// Runs the motion forward and back.
    pub(super) fn motion(
        &self,
        settled: &mut Settled,
        (quantity, parameters): (&MotionQuantity, &[Parameter]),
        (parts, memory): (StepParts, usize),
    ) -> MotionResult {
        let terms = self.terms();
        let tools: Vec<Tool> = self.tool.iter().cloned().collect();
        let Settled {
            body,
            network,
            faces,
            ..
        } = settled;
        let at_start = self.equilibrium(body, (network, faces), &terms, &tools);
        let task = MotionTask {
            steps: self.steps,
            dt: self.dt,
            scheme: self.kind,
            quantity,
            parameters,
            memory,
            parts,
            progress: &no_progress,
            error: &|failure: StepFailure, _| Error::Input(failure.to_string()),
        };
        let mut loads = |step| Ok(self.step_loads(network, step));
        gradients_of_motion(at_start, body, &task, &mut loads, &mut |values| {
            Ok(squares(values, self.steps))
        })
    }

    pub(super) fn motion_gradient(
        &self,
        of: (&MotionQuantity, &[Parameter]),
        parts: StepParts,
    ) -> crate::Result<Gradient> {
        let found = self.motion(&mut self.start(), of, (parts, usize::MAX));
        // Of a series the second number.
        found
            .gradients
            .map(|all| all.into_iter().next_back().unwrap())
    }

    /// Returns the derivatives of quantities of the motion by differences.
    pub(super) fn motion_differences(
        &self,
        all: &[MotionQuantity],
        parameters: &[Parameter],
    ) -> Vec<Vec<f64>> {
        self.differences_of(parameters, |case| case.motion_values(all))
    }

    /// As [`Case::check`], of a motion.
    pub(super) fn check_motion(&self, all: &[MotionQuantity], parameters: &[Parameter]) {
        self.check_motion_to(TOLERANCE, all, parameters);
    }

    pub(super) fn check_motion_to(
        &self,
        tolerance: f64,
        all: &[MotionQuantity],
        parameters: &[Parameter],
    ) {
        let differences = self.motion_differences(all, parameters);
        let values = self.motion_values(all);
        let mut worst: f64 = 0.0;
        for (k, quantity) in all.iter().enumerate() {
            let of = (quantity, parameters);
            let found = self.motion_gradient(of, StepParts::default()).unwrap();
            let off = (found.value - values[k]).abs();
            assert!(off <= 1e-12 * values[k].abs(), "{quantity:?}: {off}");
            assert!(found.imbalance < 1e-8, "{}", found.imbalance);
            let name = format!("{quantity:.40?}");
            let expected = (parameters, &differences[k][..]);
            worst = worst.max(self.compare(&name, &found, expected, tolerance));
        }
        println!("{}: largest relative difference {worst:.1e}", self.kind);
    }
}

#[test]
fn gradients_of_moving_bar_match_differences() {
    for kind in SCHEMES {
        let case = moving(bar(MaterialModel::NeoHookean), kind);
        case.check_motion(&of_motion(&case), &of_body(&case));
    }
}

#[test]
fn gradients_of_damped_motion_match_differences() {
    for kind in SCHEMES {
        for model in [MaterialModel::NeoHookean, MaterialModel::Corotated] {
            let case = damped(moving(bar(model), kind));
            case.check_motion(&of_motion(&case), &of_body(&case));
        }
    }
}

#[test]
fn gradients_of_moving_quadratic_tets_match_differences() {
    let case = moving(quadratic_bar(), SolverKind::Bdf2);
    case.check_motion(&of_motion(&case)[..4], &of_body(&case));
    let case = damped(case);
    case.check_motion(&of_motion(&case)[..3], &of_body(&case));
}

#[test]
fn gradients_of_motion_with_averaged_volumes_match_differences() {
    let mut case = bar(MaterialModel::NeoHookean);
    case.material.volume = VolumetricFormulation::NodalAveraged;
    case.material.poisson = 0.45;
    case.material.regions.get_mut(&1).unwrap().poisson = 0.42;
    let case = moving(case, SolverKind::Midpoint);
    let of: Vec<MotionQuantity> = quantities(&case).into_iter().map(AtEnd).collect();
    case.check_motion(&of, &of_body(&case));
    let case = damped(case);
    let refused = case.motion_gradient((&of[1], &[]), StepParts::default());
    assert!(refused.unwrap_err().to_string().contains("averaged"));
}

#[test]
fn gradients_of_motion_under_loads_match_differences() {
    for kind in SCHEMES {
        let mut case = pressed_bar();
        let fibres = case.region(0.0).into_iter().map(|t| (t, DVec3::X));
        let muscle = Muscle {
            fibres: fibres.collect(),
            tension: 5e3,
        };
        case.muscle = Some((muscle, 0.5));
        let case = moving(case, kind);
        let mut by = of_body(&case);
        by.extend([0, 1].map(|k| Parameter::Amplitude(AmplitudeId(k))));
        case.check_motion(&of_motion(&case)[..4], &by);
    }
}

#[test]
fn gradients_of_motion_of_loaded_quadratic_tets_match_differences() {
    let case = moving(loaded_quadratic_bar(), SolverKind::Midpoint);
    let mut by = of_body(&case);
    by.extend([0, 1].map(|k| Parameter::Amplitude(AmplitudeId(k))));
    case.check_motion(&of_motion(&case)[..4], &by);
}

#[test]
fn gradients_of_motion_on_floor_match_differences() {
    let mut case = bar(MaterialModel::NeoHookean);
    for (v, p) in case.mesh.nodes.iter().enumerate() {
        case.pinned[v] |= p.x > 0.12 - 1e-9;
    }
    let origin = DiscreteModel::new(&case.mesh, &case.material)
        .unwrap()
        .frame
        .origin;
    let height = DVec3::new(0.0, 0.0, 1e-3) - origin;
    case.floor = Some(Floor::new(height, DVec3::new(0.1, 0.0, 1.0), 60.0).unwrap());
    case.pull = DVec3::new(0.006, 0.002, -0.004);
    let case = moving(case, SolverKind::Bdf2);
    let mut by = of_body(&case);
    // Moving an inner node leaves the frame of the floor in place.
    let pin = by.remove(6);
    assert!(matches!(pin, Parameter::RestPosition { .. }));
    by.push(Parameter::Support {
        nodes: case.far_pins(),
        direction: DVec3::new(1.0, 0.4, -0.2),
    });
    case.check_motion(&of_motion(&case)[..4], &by);
}

/// Two numbers of one motion, of which one depends on all values and the other on the last one.
#[test]
fn gradients_of_series_match_differences() {
    let mut case = damped(moving(bar(MaterialModel::NeoHookean), SolverKind::Bdf2));
    case.steps = 7;
    let quantity = quantities(&case).remove(1);
    case.check_motion(&[Series(quantity.clone())], &of_body(&case));
    let by = of_body(&case);
    let of = |quantity: &MotionQuantity, memory: usize| {
        let mut settled = case.start();
        let result = case.motion(
            &mut settled,
            (quantity, &by),
            (StepParts::default(), memory),
        );
        (result.gradients.unwrap(), settled.body.positions())
    };
    let (series, ends) = of(&Series(quantity.clone()), usize::MAX);
    assert_eq!(
        (&series, &ends),
        (&of(&Series(quantity.clone()), 0).0, &ends)
    );
    let (at_end, same) = of(&AtEnd(quantity), usize::MAX);
    assert_eq!((&series[..1], ends), (&at_end[..], same));
}

#[test]
fn motion_in_little_memory_takes_its_steps_twice() {
    for kind in SCHEMES {
        let mut case = damped(moving(bar(MaterialModel::NeoHookean), kind));
        case.steps = 11;
        let (of, by) = (of_motion(&case), of_body(&case));
        let run = |memory: usize| {
            let mut settled = case.start();
            let parts = StepParts::default();
            let result = case.motion(&mut settled, (&of[1], &by), (parts, memory));
            assert_eq!(result.taken, case.steps);
            (result, settled.body.positions(), settled.body.velocities())
        };
        let (whole, short) = (run(usize::MAX), run(0));
        assert_eq!(whole.0.computed, case.steps);
        assert!(short.0.computed > case.steps && short.0.computed < 2 * case.steps);
        assert_eq!(whole.0.gradients.unwrap(), short.0.gradients.unwrap());
        assert_eq!((&whole.1, &whole.2), (&short.1, &short.2));
        // The body ends as after the steps alone.
        let mut settled = case.start();
        for _ in 0..case.steps {
            settled.iterations += settled.body.run(1, case.dt).unwrap().iterations;
        }
        let apart = settled.body.positions().into_iter().zip(whole.1);
        assert!(apart.map(|(a, b)| a.distance(b)).fold(0.0, f64::max) < 1e-12);
        let reverse = case.motion_gradient((&of[1], &by), StepParts::default());
        let reverse = reverse.unwrap().iterations;
        println!("{reverse} iterations back, {} forward", settled.iterations);
        // Forward and back cost at most three times as much as forward alone.
        assert!(reverse > 0 && reverse <= 2 * settled.iterations);
    }
}

fn fixed_node(case: &Case) -> Parameter {
    Parameter::InitialPosition {
        node: node_at(&case.mesh, DVec3::ZERO),
        direction: DVec3::X,
    }
}

#[test]
fn motions_without_gradient_are_refused() {
    let refusal = |case: &Case, quantity: &Quantity, by: &[Parameter]| {
        let quantity = AtEnd(quantity.clone());
        let found = case.motion_gradient((&quantity, by), StepParts::default());
        found.unwrap_err().to_string()
    };
    let kind = SolverKind::Implicit;
    let volume = |case: &Case| quantities(case).remove(2);
    let case = moving(bar(MaterialModel::Springs), kind);
    assert!(refusal(&case, &volume(&case), &[]).contains("springs"));
    let case = super::motion_contact_tests::moving_bone(kind);
    let node = node_at(&case.mesh, DVec3::new(0.12, 0.03, 0.05));
    let direction = DVec3::X;
    let begin = Parameter::InitialVelocity { node, direction };
    assert!(refusal(&case, &volume(&case), &[begin]).contains("rigid region"));
    let case = super::motion_contact_tests::moving_bone(SolverKind::Midpoint);
    let density = Parameter::Density {
        tets: case.region(1.0),
    };
    assert!(refusal(&case, &volume(&case), &[density]).contains("rigid regions"));
    let sphere = Shape::Sphere { radius: 0.02 };
    let mut rubbing = moving(super::contact_tests::tool_on_bar(sphere.clone(), 0.4), kind);
    assert!(refusal(&rubbing, &quantities(&rubbing)[0], &[]).contains("friction"));
    rubbing.tool = None;
    assert!(!refusal(&rubbing, &volume(&rubbing), &[fixed_node(&rubbing)]).contains("friction"));
    let case = moving(super::contact_tests::tool_on_bar(sphere, 0.0), kind);
    assert!(refusal(&case, &volume(&case), &[]).contains("inside a tool"));
    let by = super::motion_contact_tests::FRICTION;
    assert!(refusal(&case, &volume(&case), &[by]).contains("no friction"));
    let case = damped(moving(bar(MaterialModel::NeoHookean), kind));
    assert!(refusal(&case, &quantities(&case)[0], &[]).contains("damping"));
    let by = parameters(&case).remove(5);
    assert!(refusal(&case, &volume(&case), &[by]).contains("damping"));
    assert!(refusal(&case, &volume(&case), &[fixed_node(&case)]).contains("support"));
}
