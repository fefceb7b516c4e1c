//! A motion on the available engine and in float64, with its reference motion.

use super::device::{ACCURATE, on_engine};
use super::setting::{MotionSetting, copy_loads, rapier_simulator};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, signed_volume};
use crate::physics::{
    CgSettings, CpuTets, DiscreteModel, Engine, Material, Precision, Simulator, SolverKind,
    largest_stable_step,
};
use crate::study::reference_motion::{MotionState, ReferenceMotion, Scheme};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::HashMap;

/// Number of equal intervals of a motion; it is compared at the end of each.
pub const STOPS: u32 = 4;

/// Maximum relative change of the extrapolated reference when the step is halved.
const REFERENCE_TOLERANCE: f64 = 1e-7;

/// Indices into `MotionTrial::solved`: the motion in float64, and on the engine.
const DOUBLE: usize = 0;
const SINGLE: usize = 1;

/// Linear solves to the accuracy limit of f32.
const AS_FAR_AS_F32: CgSettings = CgSettings {
    tolerance: 1e-7,
    max_iterations: 2000,
    acceptable: 1e6,
};

/// State and errors of a motion; errors are relative to the reference motion.
#[derive(Clone, Copy, Debug)]
pub struct MotionErrors {
    /// `accurate`, `inaccurate`, `diverged` or `cg not converged`.
    pub state: &'static str,
    /// Root of the sum of squared errors over all nodes at all stops.
    pub error: f64,
    /// Error of the worst node, relative to the largest displacement of any node.
    pub largest: f64,
    /// Time discretisation error: the float64 motion with converged solves against the reference.
    pub scheme_error: f64,
    /// Error of the linear solves: against the same engine with converged solves.
    pub solver_error: f64,
    /// Rounding error of f32: the engine with converged solves, against float64.
    pub f32_error: f64,
    /// Energy error at a stop, relative to the largest kinetic and elastic energy.
    pub energy: f64,
    /// Volume error at a stop, relative to the rest volume.
    pub volume: f64,
    /// Milliseconds per simulated second.
    pub ms: f64,
    /// Iterations per step.
    pub iterations: f64,
}

/// The exact solution as a function of time, if known.
pub type Exact = Box<dyn Fn(f64) -> MotionState>;

/// Motions by solver and steps; none if the body diverged.
type Motions = HashMap<(SolverKind, u32), Option<Vec<MotionState>>>;

/// A body with its initial state and the duration of its motion.
pub struct MotionTrial {
    /// Its name.
    pub name: String,
    /// Its stiffness in `unit`.
    pub stiffness: f64,
    /// N/m or Pa.
    pub unit: &'static str,
    /// Seconds.
    pub duration: f64,
    simulator: Box<dyn Simulator>,
    /// The same body in float64.
    double: Box<dyn Simulator>,
    /// The same body in Rapier, in builds that have it and for materials that it supports.
    rapier: Option<Box<dyn Simulator>>,
    /// Initial state, and rest state.
    start: MotionState,
    rest: MotionState,
    exact: Option<Exact>,
    truth: Option<ReferenceMotion>,
    /// Motions in float64 and on the engine, with converged solves, by solver and steps.
    solved: [Motions; 2],
}

impl MotionTrial {
    /// Creates the trial of the body of `simulator`, which has springs or elements and is at rest,
    /// under its loads: from `start`, or from rest.
    ///
    /// # Errors
    /// [`Error::Input`] for a body without springs; an error if the device fails.
    pub fn of_model(
        gpu: &Gpu,
        name: &str,
        stiffness: (f64, &'static str),
        duration: f64,
        simulator: Box<dyn Simulator>,
        start: Option<MotionState>,
    ) -> Result<MotionTrial> {
        let Some(model) = simulator.model() else {
            return Err(Error::Input(format!(
                "{name}: the motion study needs a body with springs or elements"
            )));
        };
        let (kind, settings) = ReferenceMotion::converged_scheme(simulator.integrator());
        let own: (TetMesh, DiscreteModel) = (simulator.mesh().clone(), model.clone());
        // The material matters only when a body is cut.
        let material = Material::from_young(1.0);
        let mut rapier = rapier_simulator(gpu, &own, &material);
        let mut double = CpuTets::of_model(
            gpu,
            (own.0, own.1),
            &material,
            (kind, settings),
            Precision::Double,
        )?;
        let loads = simulator.loads();
        copy_loads(loads, double.loads_mut())?;
        if let Some(rapier) = &mut rapier {
            copy_loads(loads, rapier.loads_mut())?;
        }
        let both = [simulator, Box::new(double)];
        Ok(MotionTrial {
            rapier,
            ..MotionTrial::new(name, stiffness, duration, both, start)
        })
    }

    /// Creates the trial of a body from `start`, or from rest, on an engine and in float64.
    pub fn new(
        name: &str,
        (stiffness, unit): (f64, &'static str),
        duration: f64,
        [simulator, double]: [Box<dyn Simulator>; 2],
        start: Option<MotionState>,
    ) -> MotionTrial {
        let rest = MotionState::rest(double.as_ref());
        MotionTrial {
            name: name.to_owned(),
            stiffness,
            unit,
            duration,
            simulator,
            double,
            rapier: None,
            start: start.unwrap_or_else(|| rest.clone()),
            rest,
            exact: None,
            truth: None,
            solved: Default::default(),
        }
    }

    /// Returns the engine of its motions that are not in float64.
    pub fn engine(&self) -> Engine {
        self.simulator.engine()
    }

    /// Sets the exact solution.
    pub fn with_exact_solution(mut self, exact: Exact) -> MotionTrial {
        self.exact = Some(exact);
        self
    }

    /// Returns the step in seconds for `steps` steps between two stops.
    pub fn h(&self, steps: u32) -> f64 {
        self.duration / f64::from(STOPS) / f64::from(steps)
    }

    /// Returns the solvers that support it.
    pub fn kinds(&self) -> Vec<SolverKind> {
        match self.simulator.model() {
            Some(model) => {
                let mut kinds = SolverKind::ALL.to_vec();
                if model.elements().is_some() && self.engine() == Engine::Cpu {
                    kinds.extend(SolverKind::ELEMENT_ONLY);
                }
                kinds
            }
            None => vec![SolverKind::Verlet],
        }
    }

    /// Whether Rapier supports it too.
    pub fn has_rapier(&self) -> bool {
        self.rapier.is_some()
    }

    /// Returns the smallest number of steps between two stops, a power of two, at which `kind` is
    /// stable; 1 if any step is stable.
    pub fn fewest_stable(&self, kind: SolverKind) -> u32 {
        let limit = match self.simulator.model() {
            Some(model) => {
                let pinned = self.simulator.loads().pinned();
                match largest_stable_step(model, pinned, kind) {
                    // Never stable, but the instability shows late at steps that other solvers can
                    // take.
                    Some(0.0) => largest_stable_step(model, pinned, SolverKind::Symplectic),
                    limit => limit,
                }
            }
            None => self.simulator.largest_stable_step(),
        };
        let limit = 0.98 * limit.unwrap_or(f64::INFINITY);
        let wanted = (self.h(1) / limit).ceil().clamp(1.0, f64::from(1u32 << 30));
        (wanted as u32).next_power_of_two()
    }

    /// Returns the reference motion.
    ///
    /// # Errors
    /// [`Error::Input`] if the body diverges in float64 at every affordable step.
    pub fn reference(&mut self) -> Result<&ReferenceMotion> {
        if self.truth.is_none() {
            self.truth = Some(self.find_truth()?);
        }
        self.truth.as_ref().ok_or_else(|| self.no_truth())
    }

    fn no_truth(&self) -> Error {
        Error::Input(format!(
            "{}: the reference motion diverges in float64 at every time step tried; reduce the loads",
            self.name
        ))
    }

    fn find_truth(&mut self) -> Result<ReferenceMotion> {
        if let Some(exact) = &self.exact {
            let stops = 1..=STOPS;
            let states = stops.map(|k| exact(self.duration * f64::from(k) / f64::from(STOPS)));
            return Ok(ReferenceMotion {
                states: states.collect(),
                halvings: Vec::new(),
            });
        }
        // Second order.
        let kind = match self.simulator.model() {
            Some(_) => SolverKind::VelocityVerlet,
            None => SolverKind::Verlet,
        };
        let steps = self.fewest_stable(kind);
        let mut run = |steps| {
            let (double, start) = (self.double.as_mut(), &self.start);
            ReferenceMotion::simulate(
                double,
                start,
                ReferenceMotion::converged_scheme(kind),
                self.duration,
                [STOPS, steps],
            )
        };
        let probe = run(2 * steps)?;
        let scale = probe.map(|probe| motion_scale(&self.rest, &probe));
        let found = match scale {
            Some(scale) => {
                ReferenceMotion::new(steps, 64 * steps, REFERENCE_TOLERANCE, scale, run)?
            }
            None => None,
        };
        found.ok_or_else(|| self.no_truth())
    }

    /// Computes the motion and splits its error by source.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn measure(&mut self, setting: MotionSetting) -> Result<MotionErrors> {
        let h = self.h(setting.steps);
        let simulator = match (&mut self.rapier, setting.rapier) {
            (Some(rapier), true) => rapier.as_mut(),
            _ => self.simulator.as_mut(),
        };
        let outcome = on_engine(simulator, &self.start, setting, h)?;
        let mut found = MotionErrors {
            state: outcome.state,
            error: f64::NAN,
            largest: f64::NAN,
            scheme_error: f64::NAN,
            solver_error: f64::NAN,
            f32_error: f64::NAN,
            energy: f64::NAN,
            volume: f64::NAN,
            ms: f64::NAN,
            iterations: outcome.iterations,
        };
        if outcome.state != ACCURATE {
            return Ok(found);
        }
        found.ms = outcome.ms / self.duration;
        let truth = self.reference()?.states.clone();
        let scale = motion_scale(&self.rest, &truth);
        found.error = MotionState::distance(&outcome.states, &truth) / scale;
        found.largest = self.farthest(&outcome.states, &truth);
        if !setting.rapier {
            self.split_error(setting, &outcome.states, scale, &mut found)?;
        }
        (found.energy, found.volume) = self.drifts(&outcome.states, &truth)?;
        // An error above 5 % counts as inaccurate.
        if found.error.is_nan() || found.error > 0.05 {
            found.state = "inaccurate";
        }
        Ok(found)
    }

    /// Splits the error of a motion of our engines by source, relative to `scale`.
    fn split_error(
        &mut self,
        setting: MotionSetting,
        states: &[MotionState],
        scale: f64,
        found: &mut MotionErrors,
    ) -> Result<()> {
        let truth = self.reference()?.states.clone();
        let apart = |a: &[MotionState], b: &[MotionState]| MotionState::distance(a, b) / scale;
        let (kind, steps) = (setting.kind, setting.steps);
        let double = self.solved(DOUBLE, ReferenceMotion::converged_scheme(kind), steps)?;
        let single = match kind.is_implicit() {
            true => self.solved(SINGLE, (kind, AS_FAR_AS_F32), steps)?,
            false => Some(states.to_vec()),
        };
        if let Some(double) = &double {
            found.scheme_error = apart(double, &truth);
        }
        if let Some(single) = &single {
            found.solver_error = apart(states, single);
        }
        if let (Some(double), Some(single)) = (&double, &single) {
            found.f32_error = apart(single, double);
        }
        Ok(())
    }

    /// Returns the motion on one of the two engines, with converged solves.
    fn solved(
        &mut self,
        which: usize,
        scheme: Scheme,
        steps: u32,
    ) -> Result<Option<Vec<MotionState>>> {
        let key = (scheme.0, steps);
        if let Some(known) = self.solved[which].get(&key) {
            return Ok(known.clone());
        }
        let simulator = match which {
            DOUBLE => self.double.as_mut(),
            _ => self.simulator.as_mut(),
        };
        let found = ReferenceMotion::simulate(
            simulator,
            &self.start,
            scheme,
            self.duration,
            [STOPS, steps],
        )?;
        self.solved[which].insert(key, found.clone());
        Ok(found)
    }

    fn farthest(&self, found: &[MotionState], truth: &[MotionState]) -> f64 {
        let most = |a: &[MotionState], b: &dyn Fn(usize, usize) -> DVec3| {
            let states = a.iter().enumerate();
            let ways = states.flat_map(|(k, s)| {
                let nodes = s.x.iter().enumerate();
                nodes.map(move |(i, x)| x.distance(b(k, i)))
            });
            ways.fold(0.0, f64::max)
        };
        most(found, &|k, i| truth[k].x[i]) / most(truth, &|_, i| self.rest.x[i])
    }

    /// Returns the largest relative errors of energy and volume at a stop.
    fn drifts(&mut self, found: &[MotionState], truth: &[MotionState]) -> Result<(f64, f64)> {
        let (mut energy, mut volume, mut scale) = (0.0_f64, 0.0_f64, 0.0_f64);
        let whole = self.volume(&self.rest.x);
        for (a, b) in found.iter().zip(truth) {
            let (of_a, of_b) = (self.energy(a)?, self.energy(b)?);
            energy = energy.max((of_a[0] + of_a[1] - of_b[0] - of_b[1]).abs());
            scale = scale.max(of_b[0]);
            volume = volume.max((self.volume(&a.x) - self.volume(&b.x)).abs() / whole);
        }
        Ok((energy / scale, volume))
    }

    /// Returns the kinetic and elastic energy, and the energy of the loads, J.
    fn energy(&mut self, state: &MotionState) -> Result<[f64; 2]> {
        state.apply_to(self.double.as_mut())?;
        let own = self.double.report()?.energy.total;
        let loads = self.double.loads();
        let nodes = state.x.iter().zip(self.double.masses());
        let pulled = nodes.zip(loads.forces());
        let work: f64 = pulled
            .map(|((x, m), f)| x.dot(*m * loads.gravity() + *f))
            .sum();
        Ok([own, -work])
    }

    fn volume(&self, x: &[DVec3]) -> f64 {
        let tets = self.simulator.mesh().tets.iter();
        tets.map(|t| signed_volume(t.map(|v| x[v as usize]))).sum()
    }
}

/// √ΣΣ|x − rest|² over all stops: the scale of relative errors.
fn motion_scale(rest: &MotionState, states: &[MotionState]) -> f64 {
    MotionState::distance(states, &vec![rest.clone(); states.len()])
}
