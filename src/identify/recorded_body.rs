//! What a scene predicts for a recording of markers.

use super::data::Observed;
use super::readings::Readings;
use super::recording::{Recorded, Recording};
use super::swing::{Swing, lowest_points, swing_of};
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
/// Longest time step of a swing, s, and least number of steps in a period.
const LONGEST_STEP: f64 = 0.0025;
const STEPS_A_PERIOD: f64 = 40.0;
/// Largest number of further steps until the body is at rest, and of searches for the start of a swing.
const MAX_MORE_STEPS: u32 = 12;
const MAX_SEARCHES: u32 = 8;
/// Largest number of increments of gravity.
const MAX_INCREMENTS: u32 = 64;
/// Error of the start of a swing relative to its amplitude.
const START_TOLERANCE: f64 = 1e-4;
/// Longest motion that is simulated, over the one that was recorded.
const LONGEST_SWING: f64 = 2.0;

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
    carriers: Vec<Vec<(u32, f64)>>,
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
        let is_motion = matches!(self.recorded, Recorded::Motion { .. });
        let (mut motion, _) = Motion::new(gpu, &scene, kind, mesh.clone(), None)?;
        motion.set_sleep_allowed(false);
        if kind == SolverKind::Implicit || is_motion {
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

    /// Returns period and amplitude ratio of each take. The body is let go at rest from the equilibrium
    /// under so much more gravity that the marker is as far from its rest position as was recorded. Steps
    /// are `finer` times as short.
    ///
    /// # Errors
    /// As a simulation step; [`Error::Input`] without gravity, and for a body that does not swing.
    pub fn swing(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        finer: u32,
        progress: ProgressFn,
    ) -> Result<Vec<f64>> {
        let Recorded::Swing { takes, .. } = &self.recorded else {
            return Ok(Vec::new());
        };
        let Some(first) = takes.first() else {
            return Ok(Vec::new());
        };
        let count = takes.len() as f64;
        let amplitude = takes.iter().map(|take| take.amplitude).sum::<f64>() / count;
        let direction = takes
            .iter()
            .map(|take| take.direction)
            .sum::<DVec3>()
            .normalize();
        let periods = takes.iter().map(|take| take.periods).max().unwrap_or(1);
        let mut held = self.body(gpu, (scene, mesh), SolverKind::Implicit)?;
        let (start, rest) = held.start_of_swing(amplitude, direction)?;
        let mut body = self.body(gpu, (scene, mesh), scheme_of(scene))?;
        body.motion.simulator.set_positions(&start)?;
        let longest = scene
            .solver
            .dt
            .map_or(LONGEST_STEP, |dt| dt.min(LONGEST_STEP));
        let longest = longest.min(first.period / STEPS_A_PERIOD) / f64::from(finer);
        // Rounding of times adds no step.
        let steps = (first.interval / longest - 1e-6).ceil().max(1.0);
        body.motion.dt = first.interval / steps;
        let (mut times, mut depths) = (vec![0.0], vec![amplitude]);
        let most = LONGEST_SWING * first.period * (periods + 1) as f64;
        loop {
            let lows = lowest_points(&times, &depths, 0.02 * amplitude);
            if lows.len() >= periods {
                let all = [vec![[0.0, amplitude]], lows].concat();
                let measured = takes.iter().map(|take| {
                    let own = swing_of(&all[..=take.periods], direction, first.interval);
                    own.map_or([f64::NAN; 2], |own| [own.period, own.ratio])
                });
                return Ok(measured.flatten().collect());
            }
            let time = times.len() as f64 * first.interval;
            if time > most {
                return Err(Error::Input(format!(
                    "the body does not swing {periods} times in {most:.2} s; less damping ([material] damping_ratio), or a first modulus nearer to the true one (--first), may help"
                )));
            }
            body.motion.run(steps as u32, &mut |_| {})?;
            times.push(time);
            depths.push(body.displacement(0)?.dot(direction) - rest);
            crate::progress::ProgressScope::begin(progress, "swinging", time / most)?
                .check_cancelled()?;
        }
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
    fn come_to_rest(&mut self) -> Result<()> {
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
    fn come_to_rest_under(&mut self, [from, to]: [DVec3; 2]) -> Result<()> {
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
    fn gradient(
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

    /// Returns node positions with the first marker `amplitude` (m) beyond its rest position along
    /// `direction`, at rest under more gravity, and the displacement of its rest position.
    fn start_of_swing(&mut self, amplitude: f64, direction: DVec3) -> Result<(Vec<DVec3>, f64)> {
        let gravity = self.motion.simulator.loads().gravity();
        self.come_to_rest()?;
        let rest = self.displacement(0)?.dot(direction);
        if gravity == DVec3::ZERO || rest <= 0.0 {
            return Err(Error::Input(
                "a swing starts under more gravity than that of the scene, along which its marker falls; set gravity ([solver] gravity) as in the recording".into(),
            ));
        }
        let (mut before, mut factor) = ([1.0, 0.0], 1.0 + amplitude / rest);
        for _ in 0..MAX_SEARCHES {
            self.come_to_rest_under([before[0] * gravity, factor * gravity])?;
            let away = self.displacement(0)?.dot(direction) - rest;
            if (away - amplitude).abs() < START_TOLERANCE * amplitude {
                break;
            }
            let slope = (away - before[1]) / (factor - before[0]);
            before = [factor, away];
            factor += (amplitude - away) / slope;
        }
        Ok((self.motion.positions()?, rest))
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
