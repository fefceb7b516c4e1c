//! What a scene predicts for a recording of markers.

use super::data::Observed;
use super::readings::Readings;
use super::recording::{Recorded, Recording};
use super::swing::Swing;
use crate::accuracy::{EQUILIBRIUM_TOLERANCE, quasi_static_step, settle};
use crate::gpu::Gpu;
use crate::mesh::{BarycentricMap, TetMesh};
use crate::physics::{
    Capability, Engine, EngineChoice, Gradient, Parameter, Quantity, Simulator, SolverKind,
};
use crate::scene::{MassEntry, Motion, Scene};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// Names of the numbers of a swing.
const PERIOD: &str = "period (s)";
const RATIO: &str = "amplitude ratio";
/// Largest number of further steps until the body is at rest.
const MAX_MORE_STEPS: u32 = 12;
/// Largest number of increments of gravity.
const MAX_INCREMENTS: u32 = 64;

/// A recording in the frame and unit of a body.
#[derive(Clone, Debug)]
pub(super) struct RecordedBody {
    masses: Vec<MassEntry>,
    readings: Readings,
    pub(super) recorded: Recorded,
    pub observed: Vec<Observed>,
}

/// A body with markers.
pub(super) struct MarkedBody {
    pub motion: Motion,
    rest: Vec<DVec3>,
    /// Nodes that carry each marker, with weights.
    pub(super) carriers: Vec<Vec<(u32, f64)>>,
}

impl RecordedBody {
    /// Returns the recording for a body with these bounds, whose file unit is `unit` metres.
    ///
    /// # Errors
    /// As [`Recording::in_body`]; [`Error::Input`] for a displacement field of another body.
    pub fn new(
        recording: &Recording,
        (unit, bounds): (f64, (DVec3, DVec3)),
    ) -> Result<RecordedBody> {
        let recorded = recording.in_body(unit)?;
        let number = |quantity: String, at: DVec3, value: f64, scale: f64| Observed {
            quantity,
            at,
            weights: Vec::new(),
            depth: 0.0,
            value,
            scale,
        };
        let mut observed = Vec::new();
        match &recorded {
            Recorded::AtRest {
                places,
                displacements,
                field,
            } => {
                field.check(bounds)?;
                let all = displacements.iter().flatten().chain(&field.displacements);
                let farthest = all.map(|u| u.length()).fold(0.0, f64::max);
                let has_points = !(places.is_empty() && field.places.is_empty());
                if has_points && farthest == 0.0 {
                    return Err(Error::Input(
                        "the markers do not move between `straight` and `at_rest`, nor do the points of a displacement field; set times at which the body has its rest shape and at which it is loaded".into(),
                    ));
                }
                let mut add = |name: &str, at: DVec3, moved: DVec3| {
                    for (axis, value) in ["x", "y", "z"].iter().zip(moved.to_array()) {
                        observed.push(number(format!("{name} {axis} (m)"), at, value, farthest));
                    }
                };
                for (marker, (name, at)) in recording.names().iter().zip(places).enumerate() {
                    for take in displacements {
                        add(name, *at, take[marker]);
                    }
                }
                for (at, moved) in field.places.iter().zip(&field.displacements) {
                    add("displacement", *at, *moved);
                }
                observed.extend(recording.readings.observed());
            }
            Recorded::Swing { place, takes } => {
                for Swing { period, ratio, .. } in takes {
                    observed.push(number(PERIOD.into(), *place, *period, *period));
                    observed.push(number(RATIO.into(), *place, *ratio, *ratio));
                }
            }
            Recorded::Motion {
                places,
                times,
                takes,
            } => {
                let all = takes.iter().flatten().flatten();
                let farthest = all.map(|u| u.length()).fold(0.0, f64::max);
                for (time, moved) in takes.iter().flat_map(|take| times.iter().zip(take)) {
                    let markers = recording.names().into_iter().zip(places).zip(moved);
                    for ((name, at), moved) in markers {
                        for (axis, value) in ["x", "y", "z"].iter().zip(moved.to_array()) {
                            let quantity = format!("{name} {axis} after {time:.4} s (m)");
                            observed.push(number(quantity, *at, value, farthest));
                        }
                    }
                }
            }
        }
        Ok(RecordedBody {
            masses: recording.masses.clone(),
            readings: recording.readings.clone(),
            recorded,
            observed,
        })
    }

    /// Whether the markers are compared over time.
    pub fn is_over_time(&self) -> bool {
        matches!(
            self.recorded,
            Recorded::Swing { .. } | Recorded::Motion { .. }
        )
    }

    /// Returns the numbers of a swing or a motion. Steps are `finer` times as short.
    ///
    /// # Errors
    /// As a simulation step; as [`RecordedBody::swing`].
    pub fn over_time(
        &self,
        body: (&Gpu, &Scene, &TetMesh),
        finer: u32,
        progress: ProgressFn,
    ) -> Result<Vec<f64>> {
        match self.recorded {
            Recorded::Motion { .. } => self.motion(body, finer, progress),
            _ => self.swing(body, finer, progress),
        }
    }

    /// Returns the body with the loads of the recording, whose steps are of `kind`.
    pub(super) fn body(
        &self,
        gpu: &Gpu,
        (scene, mesh): (&Scene, &TetMesh),
        kind: SolverKind,
    ) -> Result<MarkedBody> {
        let mut scene = scene.clone();
        scene.mass.extend(self.masses.iter().cloned());
        scene.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
        if kind == SolverKind::Implicit {
            scene.solver.tolerance.get_or_insert(EQUILIBRIUM_TOLERANCE);
        }
        let (mut motion, _) = Motion::new(gpu, &scene, kind, mesh.clone(), None)?;
        motion.set_sleep_allowed(false);
        if kind == SolverKind::Implicit || matches!(self.recorded, Recorded::Motion { .. }) {
            let gradients = motion.simulator.gradients();
            Capability::Gradients
                .require(gradients)?
                .use_double_precision()?;
        }
        let places = match &self.recorded {
            Recorded::AtRest { places, field, .. } => [&places[..], &field.places].concat(),
            Recorded::Swing { place, .. } => vec![*place],
            Recorded::Motion { places, .. } => places.clone(),
        };
        let rest = motion.simulator.mesh().nodes.clone();
        let shares = BarycentricMap::new(motion.simulator.mesh(), &places)?;
        let carriers = shares.source_weights().iter();
        let carriers =
            carriers.map(|(nodes, weights)| nodes.iter().copied().zip(*weights).collect());
        Ok(MarkedBody {
            carriers: carriers.collect(),
            rest,
            motion,
        })
    }

    /// Returns the numbers of a body with their derivatives by parameters, which `chain` returns for its
    /// simulator; those of a swing have none.
    ///
    /// # Errors
    /// As a simulation step and a gradient.
    pub fn at_rest(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        parameters: &dyn Fn(&dyn Simulator) -> Result<Vec<Parameter>>,
    ) -> Result<Vec<Gradient>> {
        let Recorded::AtRest {
            places,
            displacements,
            ..
        } = &self.recorded
        else {
            return Ok(Vec::new());
        };
        let mut body = self.body(gpu, (scene, mesh), SolverKind::Implicit)?;
        body.come_to_rest()?;
        let parameters = parameters(body.motion.simulator.as_ref())?;
        let unit = body.motion.length_unit();
        let mut numbers = Vec::new();
        for marker in 0..body.carriers.len() {
            let mut own = Vec::new();
            for direction in DVec3::AXES {
                let quantity = Quantity::Displacement {
                    nodes: body.carriers[marker].clone(),
                    direction,
                };
                own.push(body.gradient((&quantity, unit), &parameters)?);
            }
            // Each take has the same prediction.
            let takes = match marker < places.len() {
                true => displacements.len(),
                false => 1,
            };
            (0..takes).for_each(|_| numbers.extend(own.iter().cloned()));
        }
        let others = self
            .readings
            .quantities(body.motion.simulator.mesh(), unit)?;
        for (quantity, factor) in &others {
            numbers.push(body.gradient((quantity, *factor), &parameters)?);
        }
        Ok(numbers)
    }

    /// Returns the largest difference of reactions and volumes from those of another mesh, relative to each.
    fn error_of_readings(
        &self,
        own: (&Gpu, &Scene, &TetMesh),
        finer: (&Gpu, &Scene, &TetMesh),
    ) -> Result<f64> {
        let count = self.readings.observed().len();
        if count == 0 {
            return Ok(0.0);
        }
        let [own, finer] = [own, finer].map(|body| self.at_rest(body, &|_| Ok(Vec::new())));
        let (own, finer) = (own?, finer?);
        let pairs = own.iter().zip(&finer).rev().take(count);
        let relative = pairs.map(|(a, b)| (a.value / b.value - 1.0).abs());
        Ok(relative.fold(0.0, f64::max))
    }

    /// Returns how far each marker moves until the body is at rest, m.
    ///
    /// # Errors
    /// As a simulation step.
    pub fn displacements(&self, gpu: &Gpu, scene: &Scene, mesh: &TetMesh) -> Result<Vec<DVec3>> {
        let mut body = self.body(gpu, (scene, mesh), SolverKind::Implicit)?;
        body.come_to_rest()?;
        (0..body.carriers.len())
            .map(|marker| body.displacement(marker))
            .collect()
    }

    /// Returns the error of the numbers by the mesh relative to the largest, and of a swing by the length
    /// of its steps.
    ///
    /// # Errors
    /// As a simulation step.
    pub fn discretisation_error(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        (finer_scene, finer, factor): (&Scene, &TetMesh, f64),
        progress: ProgressFn,
    ) -> Result<f64> {
        if let Recorded::Motion { .. } = self.recorded {
            let finer = (finer_scene, finer, factor);
            return self.error_of_motion((gpu, scene, mesh), finer, progress);
        }
        let readings =
            factor * self.error_of_readings((gpu, scene, mesh), (gpu, finer_scene, finer))?;
        let own = self.displacements(gpu, scene, mesh)?;
        let better = self.displacements(gpu, finer_scene, finer)?;
        if own.is_empty() {
            return Ok(readings);
        }
        let off = own
            .iter()
            .zip(&better)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        let largest = better.iter().map(|u| u.length()).fold(0.0, f64::max);
        if largest == 0.0 {
            return Err(Error::Input(
                "the body does not move; set gravity ([solver] gravity) or a load".into(),
            ));
        }
        let by_mesh = factor * off / largest;
        if !self.is_over_time() {
            return Ok(by_mesh.max(readings));
        }
        let [coarse, fine] = [1, 2].map(|finer| self.swing((gpu, scene, mesh), finer, progress));
        let pairs = coarse?.into_iter().zip(fine?);
        let by_time = pairs.map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        // A period is in proportion to the root of a compliance.
        Ok(0.5 * by_mesh + 2.0 * by_time)
    }
}

impl MarkedBody {
    /// Takes steps until the markers stay.
    pub(super) fn come_to_rest(&mut self) -> Result<()> {
        let start = self.motion.positions()?;
        let dt = quasi_static_step(&self.motion);
        let (rest, carriers) = (&self.rest, &self.carriers);
        settle(&mut self.motion, (&start, dt), &mut |motion| {
            let x = motion.positions()?;
            Ok(carriers
                .iter()
                .map(|own| moved(own, &x, rest).length())
                .collect())
        })?;
        Ok(())
    }

    /// Comes to rest under the second gravity from a state at rest under the first one, in more and smaller
    /// increments where tets would be inverted on the way.
    pub(super) fn come_to_rest_under(&mut self, [from, to]: [DVec3; 2]) -> Result<()> {
        let start = self.motion.positions()?;
        let mut increments = 1;
        loop {
            self.motion.simulator.set_positions(&start)?;
            let steps = (1..=increments).map(|k| f64::from(k) / f64::from(increments));
            let mut all = steps.map(|share| {
                let gravity = from.lerp(to, share);
                self.motion.simulator.loads_mut().set_gravity(gravity);
                self.come_to_rest()
            });
            match all.find_map(Result::err) {
                Some(Error::Solver { .. }) if increments < MAX_INCREMENTS => increments *= 4,
                Some(other) => return Err(other),
                None => return Ok(()),
            }
        }
    }

    /// Returns the number of markers.
    pub fn markers(&self) -> usize {
        self.carriers.len()
    }

    /// Returns how far a marker is from its rest place, m.
    pub fn displacement(&self, marker: usize) -> Result<DVec3> {
        let x = self.motion.positions()?;
        Ok(self.motion.length_unit() * moved(&self.carriers[marker], &x, &self.rest))
    }

    /// Returns a quantity, in file units, times a factor, with its derivatives, after more steps if the body is
    /// not at rest yet.
    pub(super) fn gradient(
        &mut self,
        (quantity, factor): (&Quantity, f64),
        parameters: &[Parameter],
    ) -> Result<Gradient> {
        let mut more = MAX_MORE_STEPS;
        loop {
            let gradients = Capability::Gradients.require(self.motion.simulator.gradients())?;
            match gradients.gradient(quantity, parameters) {
                Err(Error::Input(_)) if more > 0 => more -= 1,
                Err(other) => return Err(other),
                Ok(found) => {
                    return Ok(Gradient {
                        value: factor * found.value,
                        derivatives: found.derivatives.iter().map(|by| factor * by).collect(),
                        ..found
                    });
                }
            }
            self.motion.run(1, &mut |_| {})?;
        }
    }
}

/// Returns the scheme of a scene that steps its motions, `bdf2` if it names none for them.
pub(super) fn scheme_of(scene: &Scene) -> SolverKind {
    let named = scene.solver.name.as_deref();
    let kind = named.and_then(|name| name.parse().ok());
    let kind = kind.filter(|kind| {
        matches!(
            kind,
            SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint
        )
    });
    kind.unwrap_or(SolverKind::Bdf2)
}

fn moved(carriers: &[(u32, f64)], x: &[DVec3], rest: &[DVec3]) -> DVec3 {
    let terms = carriers.iter();
    terms
        .map(|(v, weight)| *weight * (x[*v as usize] - rest[*v as usize]))
        .sum()
}
