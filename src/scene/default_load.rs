//! Default support, load, time step and framing, chosen from the stiffness of the body.

use super::Scene;
use super::simulator::IMPLICIT_STEP;
use crate::cage::Compliance;
use crate::mesh::bounds;
use crate::number_format::significant;
use crate::physics::{ClampedEnd, DiscreteModel, Simulator, SolverKind};
use glam::DVec3;

/// Default gravity, m/s².
const GRAVITY: f64 = 9.81;
/// Target of the largest displacement, over the diagonal of the body.
const TARGET_SAG: f64 = 0.12;
/// Largest displacement during the run, if the body oscillates back before its end, and smallest
/// displacement at the end, both over the diagonal.
const MAX_DISPLACEMENT: f64 = 0.25;
const MIN_DISPLACEMENT: f64 = 0.06;
/// Largest ratio of the load to the one whose static displacement is the target, however short the
/// run is.
const MAX_LOAD_FACTOR: f64 = 4.0;
/// Smallest number of steps per half oscillation.
const STEPS_A_SWING: u32 = 20;
/// Ratio of the framed to the predicted displacement, and the rebound beyond the rest position,
/// over the predicted displacement.
const FRAMING_MARGIN: f64 = 1.3;
const RECOIL_MARGIN: f64 = 0.15;
/// Static displacement, over the diagonal, above which a body is treated as a pendulum.
const PENDULUM_DISPLACEMENT_RATIO: f64 = 0.5;

/// Load, time step and motion envelope of a run.
pub(super) struct DefaultLoad {
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Time step, s.
    pub dt: f64,
    /// Whether the load was chosen automatically, not given by the scene.
    pub automatic: bool,
    /// Points, in file units, that the view of the whole run should contain.
    pub reach: Option<Vec<DVec3>>,
}

/// An automatically chosen clamped end, and the number of pieces of the body.
pub(super) type ChosenSupport = (ClampedEnd, usize);

/// Linear response of a supported body to a step load.
struct LoadResponse {
    /// Static displacement of each node, m.
    given: Vec<DVec3>,
    /// Angular frequency of the lowest mode, rad/s.
    rate: f64,
    /// Diagonal of the bounding box, m.
    diagonal: f64,
    damping_time: f64,
}

/// Displacement during a run, over the static displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
struct OscillatorResponse {
    peak: f64,
    end: f64,
}

impl LoadResponse {
    /// Computes the response of `model`, fixed at `pinned`, to the nodal forces `load` in N;
    /// `None` if nothing can move.
    pub fn new(model: &DiscreteModel, pinned: &[bool], load: &[DVec3]) -> Option<LoadResponse> {
        let (given, rate) = Compliance::new(model, pinned)?.solve_load(load);
        let (low, high) = bounds(&model.rest_positions);
        let response = LoadResponse {
            given,
            rate,
            diagonal: (high - low).length(),
            damping_time: model.damping_time,
        };
        let max_displacement = response.max_displacement();
        (max_displacement > 0.0 && max_displacement.is_finite() && rate > 0.0 && rate.is_finite())
            .then_some(response)
    }

    /// Returns the largest nodal displacement, m.
    fn max_displacement(&self) -> f64 {
        self.given.iter().map(|u| u.length()).fold(0.0, f64::max)
    }

    /// Returns a time step of which `steps` cover half an oscillation, but at least `least`, s.
    pub fn step(&self, steps: u32, least: f64) -> f64 {
        let half = std::f64::consts::PI / self.rate;
        (half / f64::from(steps.max(STEPS_A_SWING))).max(least)
    }

    /// Simulates the lowest mode as a single oscillator with the solver's scheme.
    fn simulate_oscillator(&self, kind: SolverKind, steps: u32, dt: f64) -> OscillatorResponse {
        let stiffness = self.rate * self.rate;
        let damping = self.damping_time * stiffness;
        let (mut x, mut v, mut peak) = (0.0f64, 0.0, 0.0f64);
        for _ in 0..steps.max(1) {
            let force = stiffness * (1.0 - x);
            v = match kind {
                SolverKind::Bdf2 | SolverKind::Midpoint => {
                    let half = 0.5 * dt;
                    let w = (v + half * force) / (1.0 + half * damping + half * half * stiffness);
                    // The position is advanced by the mean velocity w, not by that at the end of
                    // the step.
                    x += dt * (v - w);
                    2.0 * w - v
                }
                SolverKind::Implicit => {
                    (v + dt * force) / (1.0 + dt * damping + dt * dt * stiffness)
                }
                _ => v + dt * (force - damping * v),
            };
            x += dt * v;
            peak = peak.max(x);
        }
        OscillatorResponse { peak, end: x }
    }

    /// Returns the load factor for which the body deflects by about a tenth of its size in the run.
    pub fn factor(&self, kind: SolverKind, steps: u32, dt: f64) -> f64 {
        let size = self.diagonal / self.max_displacement();
        let response = self.simulate_oscillator(kind, steps, dt);
        let mut factor = TARGET_SAG * size / response.peak;
        if response.end > 0.0 && factor * response.end < MIN_DISPLACEMENT * size {
            factor = (MIN_DISPLACEMENT * size / response.end)
                .min(MAX_DISPLACEMENT * size / response.peak);
        }
        match factor.is_finite() && factor > 0.0 {
            true => factor.min(MAX_LOAD_FACTOR * TARGET_SAG * size),
            false => TARGET_SAG * size,
        }
    }

    /// Returns points, in the unit of `model.rest_positions`, that the view of the whole run
    /// should contain under `factor` times the load: the rest positions and the largest
    /// displacements.
    pub fn motion_envelope(
        &self,
        model: &DiscreteModel,
        pinned: &[bool],
        factor: f64,
        (kind, steps, dt): (SolverKind, u32, f64),
    ) -> Vec<DVec3> {
        let far = factor * self.simulate_oscillator(kind, steps, dt).peak;
        let mut points = model.rest_positions.clone();
        let moving = model.rest_positions.iter().zip(&self.given);
        if far * self.max_displacement() <= PENDULUM_DISPLACEMENT_RATIO * self.diagonal {
            points.extend(moving.clone().map(|(x, u)| *x + FRAMING_MARGIN * far * *u));
            points.extend(moving.map(|(x, u)| *x - RECOIL_MARGIN * far * *u));
            return points;
        }
        let held: Vec<DVec3> = model
            .rest_positions
            .iter()
            .zip(pinned)
            .filter(|(_, pinned)| **pinned)
            .map(|(x, _)| *x)
            .collect();
        let middle = held.iter().sum::<DVec3>() / held.len().max(1) as f64;
        let down = self.given.iter().sum::<DVec3>().normalize_or_zero();
        for x in &model.rest_positions {
            let arm = *x - middle;
            let length = FRAMING_MARGIN * arm.length();
            let mirrored = 2.0 * arm.dot(down) * down - arm;
            for way in [arm, mirrored] {
                let way = way.normalize_or_zero();
                points.push(middle + length * (way + down).normalize_or_zero());
                points.push(middle + length * (way + 3.0 * down).normalize_or_zero());
            }
            points.push(middle + length * down);
        }
        points
    }
}

impl Scene {
    /// Returns the direction of loads: that of the scene's gravity, or −z.
    fn down(&self) -> DVec3 {
        let given = self.solver.gravity.map(DVec3::from);
        given.map_or(DVec3::NEG_Z, |g| match g.length() > 0.0 {
            true => g.normalize(),
            false => DVec3::NEG_Z,
        })
    }

    /// Chooses the clamped end of a body without pins.
    pub(super) fn held_end(&self, simulator: &dyn Simulator) -> ChosenSupport {
        let (rest, masses) = (&simulator.mesh().nodes, simulator.masses());
        ClampedEnd::of_largest_component(
            rest,
            masses,
            simulator.edge_nodes().into_iter(),
            self.down(),
        )
    }

    /// Chooses the clamped end of a fine body that is not simulated itself.
    pub(super) fn held_end_of(&self, model: &DiscreteModel) -> ChosenSupport {
        model.find_clamped_end(self.down())
    }

    /// Returns gravity and time step: those of the scene, or defaults chosen from the stiffness of
    /// the body if a run is planned. `held` is the model and the pinned nodes of a tetrahedral
    /// body; `end` is the clamped end if it was chosen automatically.
    pub(super) fn default_load(
        &self,
        kind: SolverKind,
        held: Option<(&DiscreteModel, &[bool])>,
        end: Option<ChosenSupport>,
        forces: Option<&[DVec3]>,
        dt: f64,
        notes: &mut Vec<String>,
    ) -> DefaultLoad {
        let across = end
            .as_ref()
            .map_or(DVec3::NEG_Z, |(end, _)| end.load_direction());
        let given = self.solver.gravity.map(DVec3::from);
        let mut pull = DefaultLoad {
            gravity: given.unwrap_or(GRAVITY * across),
            dt,
            automatic: false,
            reach: None,
        };
        let silent = given.is_none()
            && forces.is_none()
            && self.grab.is_empty()
            && self.cut.is_empty()
            && self.tets_only_entry().is_none()
            && end.is_some();
        let ahead = self.solver.run.filter(|run| run.steps > 0);
        let mut how = format!(
            "applying gravity of {}",
            format_acceleration(pull.gravity.length())
        );
        if let (true, Some(run), Some((model, pinned))) = (silent, ahead, held)
            && let Some(response) = LoadResponse::new(model, pinned, &weight(model, across))
        {
            if self.solver.dt.is_none() && kind.is_implicit() {
                pull.dt = response.step(run.steps, IMPLICIT_STEP);
            }
            let factor = response.factor(kind, run.steps, pull.dt);
            pull.gravity = factor * across;
            pull.automatic = true;
            pull.reach =
                Some(response.motion_envelope(model, pinned, factor, (kind, run.steps, pull.dt)));
            how = format!(
                "applying a load of {}, chosen for a deflection of about a tenth of the body size,",
                format_acceleration(factor)
            );
        } else if let Some(run) = ahead.filter(|run| run.draws_frames && self.camera.is_unset())
            && let Some((model, pinned)) = held
        {
            let mut load = weight(model, pull.gravity);
            for (load, force) in load.iter_mut().zip(forces.unwrap_or_default()) {
                *load += *force;
            }
            let response = LoadResponse::new(model, pinned, &load);
            pull.reach =
                response.map(|r| r.motion_envelope(model, pinned, 1.0, (kind, run.steps, dt)));
        }
        if let Some((model, _)) = held {
            for point in pull.reach.iter_mut().flatten() {
                *point = model.to_file(*point);
            }
        }
        if let Some((end, pieces)) = end {
            let pieces = match pieces {
                1 => String::new(),
                n => format!(" and one end of each of its {n} components"),
            };
            let along = along(pull.gravity);
            notes.push(format!(
                "clamped {end}{pieces}; {how} along {along}; override with [[pin]] and --gravity"
            ));
        }
        if pull.dt != dt {
            notes.push(format!(
                "time step {} s, chosen to cover half an oscillation; override with --dt",
                significant(pull.dt)
            ));
        }
        pull
    }
}

/// Returns the weight of the nodes of `model` at 1 m/s² along `direction`, N.
fn weight(model: &DiscreteModel, direction: DVec3) -> Vec<DVec3> {
    model.masses.iter().map(|m| *m * direction).collect()
}

/// Formats a direction.
fn along(vector: DVec3) -> String {
    let unit = vector.normalize_or_zero();
    let axis = unit.abs().max_position();
    match unit[axis].abs() > 0.999 {
        true => format!(
            "{}{}",
            if unit[axis] < 0.0 { "-" } else { "+" },
            ["x", "y", "z"][axis]
        ),
        false => format!("({:.3}, {:.3}, {:.3})", unit.x, unit.y, unit.z),
    }
}

/// Formats an acceleration, with its ratio to the earth's gravity if they differ by much.
fn format_acceleration(gravity: f64) -> String {
    let figures = match gravity {
        g if !(0.1..1e4).contains(&g) => format!("{g:.2e}"),
        g if g < 10.0 => format!("{g:.2}"),
        g => format!("{g:.0}"),
    };
    let earth = gravity / GRAVITY;
    match earth {
        e if (0.5..2.0).contains(&e) => format!("{figures} m/s²"),
        e if (0.01..1e4).contains(&e) => {
            format!(
                "{figures} m/s² ({} times the earth's)",
                (e * 100.0).round() / 100.0
            )
        }
        _ => format!("{figures} m/s²"),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::physics::{ClampedEnd, Material};

    #[test]
    fn default_load_scales_with_stiffness_and_step_with_period() {
        let bar = generate::paper_bar().unwrap();
        let factor = |young: f64| {
            let model = DiscreteModel::new(&bar, &Material::from_young(young)).unwrap();
            let all: Vec<u32> = (0..bar.nodes.len() as u32).collect();
            let end =
                ClampedEnd::from_points(&model.rest_positions, &model.masses, &all, DVec3::NEG_Z);
            let mut pinned = vec![false; bar.nodes.len()];
            end.nodes.iter().for_each(|v| pinned[*v as usize] = true);
            let load = weight(&model, DVec3::NEG_Z);
            let response = LoadResponse::new(&model, &pinned, &load).unwrap();
            let dt = response.step(50, 0.0);
            let swing = response.simulate_oscillator(SolverKind::Implicit, 50, dt);
            assert!(
                swing.peak > 1.0 && swing.end > 0.9 * swing.peak,
                "{swing:?}"
            );
            (response.factor(SolverKind::Implicit, 50, dt), dt)
        };
        let (soft, stiff) = (factor(1e4), factor(1e6));
        assert!(
            (stiff.0 / soft.0 / 100.0 - 1.0).abs() < 0.05,
            "{soft:?} {stiff:?}"
        );
        assert!(
            (soft.1 / stiff.1 / 10.0 - 1.0).abs() < 0.05,
            "{soft:?} {stiff:?}"
        );
    }

    #[test]
    fn accelerations_format_in_three_figures() {
        assert_eq!(format_acceleration(9.81), "9.81 m/s²");
        assert_eq!(format_acceleration(98.1), "98 m/s² (10 times the earth's)");
        assert_eq!(format_acceleration(1e-6), "1.00e-6 m/s²");
    }
}
