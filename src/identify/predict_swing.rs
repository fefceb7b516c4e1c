//! What a scene predicts for a swing, with derivatives by the adjoint method: one motion forward and one back
//! for each number.
//!
//! The body is let go at rest from the equilibrium x₀ under f times the gravity g, where f makes the marker as
//! far from its rest position as was recorded. A number N of the motion depends on a parameter p directly, by
//! x₀(p, f(p)), and by the rest position r of the marker.

use super::recorded_body::{MarkedBody, RecordedBody, scheme_of};
use super::recording::Recorded;
use super::swing::{LowestPoint, Swing, lowest_points, swing_of};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{Capability, Gradient, Parameter, Quantity, Simulator, SolverKind};
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// Longest time step of a swing, s, and least number of steps in a period.
const LONGEST_STEP: f64 = 0.0025;
const STEPS_A_PERIOD: f64 = 40.0;
/// Largest number of searches for the start of a swing.
const MAX_SEARCHES: u32 = 8;
/// Error of the start of a swing relative to its amplitude, and where it has derivatives.
const START_TOLERANCE: f64 = 1e-4;
const EXACT_START: f64 = 1e-10;
/// Longest motion that is simulated, over the one that was recorded.
const LONGEST_SWING: f64 = 2.0;
/// Smallest amplitude that counts, relative to the first.
const LEAST_SWING: f64 = 0.02;

/// The takes of a swing as one.
struct Takes<'a> {
    all: &'a [Swing],
    amplitude: f64,
    direction: DVec3,
    /// Most periods of a take.
    periods: usize,
    /// Time between two rows, s, and steps in it.
    interval: f64,
    steps: usize,
    /// Longest motion, s.
    most: f64,
}

/// The body before it is let go.
struct HeldBody {
    body: MarkedBody,
    start: Vec<DVec3>,
    /// Gravity of the scene, and how many times as much holds the body.
    gravity: DVec3,
    factor: f64,
    /// How far the marker is from its place in the mesh at rest, m.
    rest: Gradient,
}

/// Parameters of a body at rest, and the numbers of those of its motion that they are.
struct RestParameters {
    parameters: Vec<Parameter>,
    numbers: Vec<usize>,
}

impl RecordedBody {
    /// Returns period and amplitude ratio of each take. Steps are `finer` times as short.
    ///
    /// # Errors
    /// As a simulation step; [`Error::Input`] without gravity, and for a body that does not swing.
    pub fn swing(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        finer: u32,
        progress: ProgressFn,
    ) -> Result<Vec<f64>> {
        let Some(takes) = self.takes(scene, finer) else {
            return Ok(Vec::new());
        };
        let none = RestParameters::of(&[]);
        let held = self.held((gpu, scene, mesh), (&takes, START_TOLERANCE), &none)?;
        let mut body = self.body(gpu, (scene, mesh), scheme_of(scene))?;
        body.motion.simulator.set_positions(&held.start)?;
        body.motion.dt = takes.interval / takes.steps as f64;
        let mut depths = vec![takes.amplitude];
        loop {
            if let Some(lows) = takes.lows(&depths)? {
                let numbers = takes.all.iter().map(|take| takes.numbers(take, &lows));
                return Ok(numbers.flatten().collect());
            }
            body.motion.run(takes.steps as u32, &mut |_| {})?;
            depths.push(body.displacement(0)?.dot(takes.direction) - held.rest.value);
            let share = depths.len() as f64 * takes.interval / takes.most;
            crate::progress::ProgressScope::begin(progress, "swinging", share)?
                .check_cancelled()?;
        }
    }

    /// As [`RecordedBody::swing`], with derivatives by parameters of the motion, which `parameters` returns for
    /// its simulator.
    ///
    /// # Errors
    /// As [`RecordedBody::swing`]; [`Error::Input`] for a body whose motion has no gradients.
    pub fn swing_gradients(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        parameters: &dyn Fn(&dyn Simulator) -> Result<Vec<Parameter>>,
        progress: ProgressFn,
    ) -> Result<Vec<Gradient>> {
        let Some(takes) = self.takes(scene, 1) else {
            return Ok(Vec::new());
        };
        let mut body = self.body(gpu, (scene, mesh), scheme_of(scene))?;
        let own = parameters(body.motion.simulator.as_ref())?;
        let at_rest = RestParameters::of(&own);
        let gradients = body.motion.simulator.gradients();
        Capability::Gradients
            .require(gradients)?
            .use_double_precision()?;
        let mut held = self.held((gpu, scene, mesh), (&takes, EXACT_START), &at_rest)?;
        let by_factor = held.by_factor(&takes, &at_rest)?;
        body.motion.simulator.set_positions(&held.start)?;
        body.motion.dt = takes.interval / takes.steps as f64;
        let free = body.free_nodes();
        let start = free.iter().flat_map(|node| {
            DVec3::AXES.map(|direction| Parameter::InitialPosition {
                node: *node,
                direction,
            })
        });
        let all: Vec<Parameter> = own.iter().cloned().chain(start).collect();
        let unit = body.motion.length_unit();
        let most = takes.steps * (takes.most / takes.interval).ceil() as usize + takes.steps;
        // What each number depends on by the rest position of the marker.
        let mut by_rest = Vec::new();
        let mut read = |values: &[f64]| {
            let depths = takes.depths(values, (unit, held.rest.value));
            let Some(lows) = depths
                .as_ref()
                .map(|depths| takes.lows(depths))
                .transpose()?
                .flatten()
            else {
                return Ok(None);
            };
            let depths = depths.unwrap_or_default();
            let numbers = takes.distinct().into_iter().flat_map(|take| {
                let numbers = takes.numbers(take, &lows);
                let slopes = takes.slopes(take, &lows, &depths);
                numbers.into_iter().zip(slopes)
            });
            let numbers = numbers.map(|(number, by_depths)| {
                by_rest.push(-by_depths.iter().sum::<f64>());
                (number, takes.by_values(&by_depths, (values.len(), unit)))
            });
            Ok(Some(numbers.collect()))
        };
        let quantity = Quantity::Displacement {
            nodes: body.carriers[0].clone(),
            direction: takes.direction,
        };
        let found =
            body.motion
                .gradients_of_series(most as u32, &quantity, &mut read, &all, progress)?;
        let mut numbers = Vec::new();
        for (mut gradient, by_rest) in found.into_iter().zip(by_rest) {
            let by_start = gradient.derivatives.split_off(own.len());
            let through_start = held.contracted((&free, &by_start), &at_rest)?;
            for (k, number) in at_rest.numbers.iter().enumerate() {
                let by = through_start[k] + through_start[at_rest.numbers.len()] * by_factor[k];
                gradient.derivatives[*number] += by + by_rest * held.rest.derivatives[k];
            }
            numbers.push(gradient);
        }
        let of_take = |take: &Swing| {
            let mut all = takes.distinct().into_iter();
            let n = all.position(|other| other.periods == take.periods);
            n.map_or(&numbers[..0], |n| &numbers[2 * n..2 * n + 2])
                .to_vec()
        };
        Ok(takes.all.iter().flat_map(of_take).collect())
    }

    /// Returns the takes of the swing, for a scene.
    fn takes(&self, scene: &Scene, finer: u32) -> Option<Takes<'_>> {
        let Recorded::Swing { takes, .. } = &self.recorded else {
            return None;
        };
        let first = takes.first()?;
        let periods = takes.iter().map(|take| take.periods).max().unwrap_or(1);
        let direction: DVec3 = takes.iter().map(|take| take.direction).sum();
        let dt = scene.solver.dt.unwrap_or(LONGEST_STEP);
        let longest = dt.min(LONGEST_STEP).min(first.period / STEPS_A_PERIOD) / f64::from(finer);
        Some(Takes {
            amplitude: takes.iter().map(|take| take.amplitude).sum::<f64>() / takes.len() as f64,
            direction: direction.normalize_or_zero(),
            // Rounding of times adds no step.
            steps: (first.interval / longest - 1e-6).ceil().max(1.0) as usize,
            interval: first.interval,
            most: LONGEST_SWING * first.period * (periods + 1) as f64,
            all: takes,
            periods,
        })
    }

    /// Returns the body before it is let go, and the derivatives of its rest position.
    fn held(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        (takes, tolerance): (&Takes<'_>, f64),
        by: &RestParameters,
    ) -> Result<HeldBody> {
        let mut body = self.body(gpu, (scene, mesh), SolverKind::Implicit)?;
        let gravity = body.motion.simulator.loads().gravity();
        body.come_to_rest()?;
        let rest = match by.parameters.is_empty() {
            true => Gradient {
                value: body.displacement(0)?.dot(takes.direction),
                ..Gradient::default()
            },
            false => body.gradient_of_marker(takes.direction, &by.parameters)?,
        };
        let mut held = HeldBody {
            start: Vec::new(),
            factor: 1.0,
            body,
            gravity,
            rest,
        };
        held.move_to(takes, tolerance)?;
        Ok(held)
    }
}

impl HeldBody {
    /// Finds the factor of gravity that holds the marker as far from its rest position as was recorded.
    fn move_to(&mut self, takes: &Takes<'_>, tolerance: f64) -> Result<()> {
        let (amplitude, rest) = (takes.amplitude, self.rest.value);
        if self.gravity == DVec3::ZERO || rest <= 0.0 {
            return Err(Error::Input(
                "a swing starts under more gravity than that of the scene, along which its marker falls; set gravity ([solver] gravity) as in the recording".into(),
            ));
        }
        let (mut before, mut factor) = ([1.0, 0.0], 1.0 + amplitude / rest);
        for _ in 0..MAX_SEARCHES {
            let gravities = [before[0], factor].map(|factor| factor * self.gravity);
            self.body.come_to_rest_under(gravities)?;
            self.factor = factor;
            let away = self.body.displacement(0)?.dot(takes.direction) - rest;
            if (away - amplitude).abs() < tolerance * amplitude {
                break;
            }
            let slope = (away - before[1]) / (factor - before[0]);
            before = [factor, away];
            factor += (amplitude - away) / slope;
        }
        self.start = self.body.motion.positions()?;
        Ok(())
    }

    /// Returns the derivatives of the factor of gravity by the parameters: the marker stays as far from its rest
    /// position.
    fn by_factor(&mut self, takes: &Takes<'_>, by: &RestParameters) -> Result<Vec<f64>> {
        let own = self
            .body
            .gradient_of_marker(takes.direction, &self.parameters(by))?;
        let own = self.of_held(own.derivatives, by);
        let by_factor = own[by.numbers.len()];
        let rest = self.rest.derivatives.iter().zip(own);
        Ok(rest.map(|(rest, own)| (rest - own) / by_factor).collect())
    }

    /// Returns Σ λ·∂x₀ by the parameters and by the factor of gravity; `slopes` are λ of the free nodes, three
    /// components each.
    fn contracted(
        &mut self,
        (free, slopes): (&[u32], &[f64]),
        by: &RestParameters,
    ) -> Result<Vec<f64>> {
        let parameters = self.parameters(by);
        let mut sums = vec![0.0; parameters.len()];
        for (axis, direction) in DVec3::AXES.into_iter().enumerate() {
            let weights = slopes.iter().skip(axis).step_by(3);
            let quantity = Quantity::Displacement {
                nodes: free.iter().copied().zip(weights.copied()).collect(),
                direction,
            };
            let found = self.body.gradient((&quantity, 1.0), &parameters)?;
            let own = self.of_held(found.derivatives, by);
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        Ok(sums)
    }

    /// Returns the parameters with the factor of gravity behind them.
    fn parameters(&self, by: &RestParameters) -> Vec<Parameter> {
        let gravity = Parameter::Gravity {
            direction: self.gravity,
        };
        by.parameters.iter().cloned().chain([gravity]).collect()
    }

    /// Returns derivatives by the gravity of the scene in place of those by the one that holds the body.
    fn of_held(&self, mut derivatives: Vec<f64>, by: &RestParameters) -> Vec<f64> {
        for (own, parameter) in derivatives.iter_mut().zip(&by.parameters) {
            if let Parameter::Gravity { .. } = parameter {
                *own *= self.factor;
            }
        }
        derivatives
    }
}

impl MarkedBody {
    /// Returns how far the first marker has moved along a direction at rest, m, with derivatives.
    fn gradient_of_marker(&mut self, direction: DVec3, by: &[Parameter]) -> Result<Gradient> {
        let quantity = Quantity::Displacement {
            nodes: self.carriers[0].clone(),
            direction,
        };
        let unit = self.motion.length_unit();
        self.gradient((&quantity, unit), by)
    }

    fn free_nodes(&self) -> Vec<u32> {
        let fixed = self.motion.simulator.loads().fixed_nodes();
        let all = fixed.iter().zip(0..).filter(|(fixed, _)| !**fixed);
        all.map(|(_, node)| node).collect()
    }
}

impl RestParameters {
    /// Returns those on which a body at rest depends.
    fn of(all: &[Parameter]) -> RestParameters {
        let is_of_motion =
            |p: &Parameter| matches!(p, Parameter::DampingTime | Parameter::MassDamping);
        let own = all.iter().enumerate().filter(|(_, p)| !is_of_motion(p));
        let (numbers, parameters) = own.map(|(k, p)| (k, p.clone())).unzip();
        RestParameters {
            parameters,
            numbers,
        }
    }
}

impl Takes<'_> {
    /// Returns the lowest points, if there are as many as the takes have periods.
    ///
    /// # Errors
    /// [`Error::Input`] if there are not after the longest motion.
    fn lows(&self, depths: &[f64]) -> Result<Option<Vec<LowestPoint>>> {
        let times: Vec<f64> = (0..depths.len())
            .map(|k| k as f64 * self.interval)
            .collect();
        let lows = lowest_points(&times, depths, LEAST_SWING * self.amplitude);
        if lows.len() >= self.periods {
            return Ok(Some(lows));
        }
        match depths.len() as f64 * self.interval > self.most {
            false => Ok(None),
            true => Err(Error::Input(format!(
                "the body does not swing {} times in {:.2} s; less damping ([material] damping_ratio), or a first modulus nearer to the true one (--first), may help",
                self.periods, self.most
            ))),
        }
    }

    /// Returns the depths of all rows so far, from the values after each step; `None` within a row.
    fn depths(&self, values: &[f64], (unit, rest): (f64, f64)) -> Option<Vec<f64>> {
        let rows = values.iter().skip(self.steps - 1).step_by(self.steps);
        let depths = || {
            [self.amplitude]
                .into_iter()
                .chain(rows.map(|x| unit * x - rest))
        };
        values
            .len()
            .is_multiple_of(self.steps)
            .then(|| depths().collect())
    }

    /// Returns period and amplitude ratio of a take.
    fn numbers(&self, take: &Swing, lows: &[LowestPoint]) -> [f64; 2] {
        let own = lows
            .iter()
            .take(take.periods)
            .map(|low| [low.time, low.depth]);
        let all: Vec<[f64; 2]> = [[0.0, self.amplitude]].into_iter().chain(own).collect();
        let swing = swing_of(&all, self.direction, self.interval);
        swing.map_or([f64::NAN; 2], |swing| [swing.period, swing.ratio])
    }

    /// Returns the derivatives of period and amplitude ratio of a take by the depth of each row.
    fn slopes(&self, take: &Swing, lows: &[LowestPoint], depths: &[f64]) -> [Vec<f64>; 2] {
        let mut found = [vec![0.0; depths.len()], vec![0.0; depths.len()]];
        let last = take.periods.checked_sub(1).and_then(|n| lows.get(n));
        let Some((low, slopes)) =
            last.and_then(|low| Some((low, low.slopes(depths, self.interval)?)))
        else {
            return found;
        };
        let periods = take.periods as f64;
        let ratio = (low.depth / self.amplitude).powf(1.0 / periods);
        let factors = [1.0 / periods, ratio / (periods * low.depth)];
        for ((all, factor), slopes) in found.iter_mut().zip(factors).zip(slopes) {
            for (k, slope) in slopes.into_iter().enumerate() {
                all[low.row + k - 1] = factor * slope;
            }
        }
        found
    }

    /// Returns derivatives by the values after each of `count` steps from those by the depths of rows.
    fn by_values(&self, by_depths: &[f64], (count, unit): (usize, f64)) -> Vec<f64> {
        let mut by_values = vec![0.0; count];
        // The first row is the start.
        for (row, by) in by_depths.iter().enumerate().skip(1) {
            by_values[row * self.steps - 1] = unit * by;
        }
        by_values
    }

    /// The first take of each number of periods.
    fn distinct(&self) -> Vec<&Swing> {
        let mut found: Vec<&Swing> = Vec::new();
        for take in self.all {
            if found.iter().all(|other| other.periods != take.periods) {
                found.push(take);
            }
        }
        found
    }
}
