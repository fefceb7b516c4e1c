//! A body that moves, on the GPU and in float64, and the motion it ought to make.

use super::device::{ACCURATE, on_engine};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, signed_volume};
use crate::physics::grid::plain::GridTwin;
use crate::physics::grid::{GpuGrid, GridBody};
use crate::physics::plain::springs::Particles;
use crate::physics::plain::truth::{self, State, Truth, TwinScheme};
use crate::physics::{Body, GpuTets, Simulator, SolverKind, largest_stable_step};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::HashMap;

/// Equal spans of a motion, at whose ends it is compared.
pub const STOPS: u32 = 4;

/// What halving the step may still change of what the truth is extrapolated to, relative.
const TRUTH: f64 = 1e-7;

/// How a motion is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Which solver.
    pub kind: SolverKind,
    /// Steps in each of the spans.
    pub steps: u32,
    /// Where conjugate gradients stop: the residual, and the iterations.
    pub cg: Option<(f64, u32)>,
}

/// What became of it; errors are relative to the true motion.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// `accurate`, `inaccurate`, `diverged` or `cg not converged`.
    pub state: &'static str,
    /// Of all nodes at all stops, root of the sum of squares.
    pub error: f64,
    /// Of the one node that is farthest off, relative to the longest way of any.
    pub largest: f64,
    /// Of the scheme: its float64 twin, solved to the last digits, against the truth.
    pub time: f64,
    /// Of the linear solves: that twin with the same stop of conjugate gradients, against it
    /// solved.
    pub solver: f64,
    /// Of f32: the GPU against that twin.
    pub single: f64,
    /// Of the energy at a stop, relative to the largest energy of motion and springs.
    pub energy: f64,
    /// Of the volume at a stop, relative to the volume.
    pub volume: f64,
    /// Milliseconds for a simulated second.
    pub ms: f64,
    /// Iterations a step.
    pub iterations: f64,
}

/// The same body in float64, where it starts.
enum Twin {
    /// Of tets.
    Tets(Box<Particles>),
    /// Of a grid.
    Grid(Box<GridTwin>),
}

/// Where a body would be at a time, where that is known exactly.
pub type Exact = Box<dyn Fn(f64) -> State>;

/// A body, a start, a duration.
pub struct Trial {
    /// Its name.
    pub name: String,
    /// Its stiffness in `unit`.
    pub stiffness: f64,
    /// N/m or Pa.
    pub unit: &'static str,
    /// Seconds.
    pub duration: f64,
    simulator: Box<dyn Simulator>,
    twin: Twin,
    exact: Option<Exact>,
    truth: Option<Truth>,
    /// Twins solved to the last digits, by solver and steps.
    solved: HashMap<(SolverKind, u32), Option<Vec<State>>>,
}

impl Trial {
    /// The motion of `body`, made of `mesh`, from the positions (in metres from its frame's
    /// origin) and velocities given.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn tets(
        gpu: &Gpu,
        name: &str,
        stiffness: (f64, &'static str),
        duration: f64,
        (mesh, body): (TetMesh, Body),
        start: Option<State>,
    ) -> Result<Trial> {
        let solver = SolverKind::Symplectic.solver(gpu, &body)?;
        let simulator = Box::new(GpuTets::of_body(mesh, body, solver)?);
        Ok(Trial::of_springs(
            name, stiffness, duration, simulator, start,
        ))
    }

    /// The same of a simulator whose body has springs.
    pub fn of_springs(
        name: &str,
        stiffness: (f64, &'static str),
        duration: f64,
        simulator: Box<dyn Simulator>,
        start: Option<State>,
    ) -> Trial {
        let network = simulator.network().cloned().unwrap_or_default();
        let mut p = Particles::new(network);
        let loads = simulator.loads();
        p.pinned = loads.pinned().to_vec();
        p.gravity = loads.gravity();
        p.external = loads.forces().to_vec();
        if let Some(start) = start {
            (p.x, p.v) = (start.x, start.v);
        }
        Trial::new(name, stiffness, duration, simulator, Twin::Tets(p.into()))
    }

    /// The motion of a grid body, from rest.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn grid(
        gpu: &Gpu,
        name: &str,
        stiffness: (f64, &'static str),
        duration: f64,
        body: GridBody,
        twin: GridTwin,
    ) -> Result<Trial> {
        let mesh = body.mesh().clone();
        let simulator = Box::new(GpuGrid::new(gpu, body, mesh)?);
        let twin = Twin::Grid(twin.into());
        Ok(Trial::new(name, stiffness, duration, simulator, twin))
    }

    fn new(
        name: &str,
        (stiffness, unit): (f64, &'static str),
        duration: f64,
        simulator: Box<dyn Simulator>,
        twin: Twin,
    ) -> Trial {
        Trial {
            name: name.to_owned(),
            stiffness,
            unit,
            duration,
            simulator,
            twin,
            exact: None,
            truth: None,
            solved: HashMap::new(),
        }
    }

    /// The same with an exact solution.
    pub fn exactly(mut self, exact: Exact) -> Trial {
        self.exact = Some(exact);
        self
    }

    /// Seconds of a step when there are `steps` between two stops.
    pub fn h(&self, steps: u32) -> f64 {
        self.duration / f64::from(STOPS) / f64::from(steps)
    }

    /// The solvers that can move it.
    pub fn kinds(&self) -> Vec<SolverKind> {
        match self.twin {
            Twin::Tets(_) => SolverKind::ALL.to_vec(),
            Twin::Grid(_) => vec![SolverKind::Verlet],
        }
    }

    /// The fewest steps between two stops, a power of two, at which `kind` is stable; 1 where
    /// any step is.
    pub fn fewest_stable(&self, kind: SolverKind) -> u32 {
        let limit = match (&self.twin, self.simulator.network()) {
            (Twin::Tets(p), Some(network)) => {
                match largest_stable_step(network, &p.pinned, kind) {
                    // Never stable, but it takes long to show at steps that others can take.
                    Some(0.0) => largest_stable_step(network, &p.pinned, SolverKind::Symplectic),
                    limit => limit,
                }
            }
            _ => self.simulator.largest_stable_step(),
        };
        let limit = 0.98 * limit.unwrap_or(f64::INFINITY);
        let wanted = (self.h(1) / limit).ceil().clamp(1.0, f64::from(1u32 << 30));
        (wanted as u32).next_power_of_two()
    }

    /// The motion it ought to make.
    ///
    /// # Errors
    /// [`Error::Input`] where the float64 twin flies apart at every step that is affordable.
    pub fn truth(&mut self) -> Result<&Truth> {
        if self.truth.is_none() {
            self.truth = Some(self.find_truth()?);
        }
        self.truth.as_ref().ok_or_else(|| self.no_truth())
    }

    fn no_truth(&self) -> Error {
        Error::Input(format!(
            "{}: the body flies apart in float64 too, at every step tried; soften what drives it",
            self.name
        ))
    }

    fn find_truth(&self) -> Result<Truth> {
        if let Some(exact) = &self.exact {
            let stops = 1..=STOPS;
            let states = stops.map(|k| exact(self.duration * f64::from(k) / f64::from(STOPS)));
            return Ok(Truth {
                states: states.collect(),
                halvings: Vec::new(),
            });
        }
        let steps = self.fewest_stable(SolverKind::VelocityVerlet);
        let run = |steps| match &self.twin {
            Twin::Tets(p) => {
                let scheme = TwinScheme::converged(SolverKind::VelocityVerlet);
                truth::motion(p, scheme, self.duration, STOPS, steps)
            }
            Twin::Grid(p) => truth::grid_motion(p, self.duration, STOPS, steps),
        };
        let probe = run(2 * steps).ok_or_else(|| self.no_truth())?;
        let scale = self.way(&probe);
        truth::truth(steps, 64 * steps, TRUTH, scale, run).ok_or_else(|| self.no_truth())
    }

    /// √ΣΣ|x − rest|² over all stops: what errors are relative to.
    fn way(&self, states: &[State]) -> f64 {
        let rest = State {
            x: self.rest().to_vec(),
            v: Vec::new(),
        };
        truth::distance(states, &vec![rest; states.len()])
    }

    fn rest(&self) -> &[DVec3] {
        match &self.twin {
            Twin::Tets(p) => &p.network.rest,
            Twin::Grid(p) => &p.x,
        }
    }

    /// Makes the motion, and tells its errors apart.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn measure(&mut self, setting: Setting) -> Result<Found> {
        let h = self.h(setting.steps);
        let start = self.start();
        let outcome = on_engine(self.simulator.as_mut(), &start, setting, h)?;
        let mut found = Found {
            state: outcome.state,
            error: f64::NAN,
            largest: f64::NAN,
            time: f64::NAN,
            solver: f64::NAN,
            single: f64::NAN,
            energy: f64::NAN,
            volume: f64::NAN,
            ms: f64::NAN,
            iterations: outcome.iterations,
        };
        if outcome.state != ACCURATE {
            return Ok(found);
        }
        found.ms = outcome.ms / self.duration;
        let truth = self.truth()?.states.clone();
        let scale = self.way(&truth);
        let solved = self.solved_twin(setting);
        let twin = match setting.cg {
            Some((tolerance, iterations)) => self.twin(
                TwinScheme {
                    kind: setting.kind,
                    tolerance,
                    iterations,
                },
                setting.steps,
            ),
            None => solved.clone(),
        };
        let apart = |a: &[State], b: &[State]| truth::distance(a, b) / scale;
        found.error = apart(&outcome.states, &truth);
        found.largest = self.farthest(&outcome.states, &truth);
        if let Some(solved) = &solved {
            found.time = apart(solved, &truth);
        }
        if let Some(twin) = &twin {
            found.single = apart(&outcome.states, twin);
        }
        if let (Some(solved), Some(twin)) = (&solved, &twin) {
            found.solver = apart(twin, solved);
        }
        (found.energy, found.volume) = self.drifts(&outcome.states, &truth);
        // More than a twentieth of the way off is another motion.
        if found.error.is_nan() || found.error > 0.05 {
            found.state = "inaccurate";
        }
        Ok(found)
    }

    /// Where it starts.
    fn start(&self) -> State {
        match &self.twin {
            Twin::Tets(p) => State {
                x: p.x.clone(),
                v: p.v.clone(),
            },
            Twin::Grid(p) => State {
                x: p.x.clone(),
                v: vec![DVec3::ZERO; p.x.len()],
            },
        }
    }

    fn solved_twin(&mut self, setting: Setting) -> Option<Vec<State>> {
        let key = (setting.kind, setting.steps);
        if let Some(known) = self.solved.get(&key) {
            return known.clone();
        }
        let twin = self.twin(TwinScheme::converged(setting.kind), setting.steps);
        self.solved.insert(key, twin.clone());
        twin
    }

    fn twin(&self, scheme: TwinScheme, steps: u32) -> Option<Vec<State>> {
        match &self.twin {
            Twin::Tets(p) => truth::motion(p, scheme, self.duration, STOPS, steps),
            Twin::Grid(p) => truth::grid_motion(p, self.duration, STOPS, steps),
        }
    }

    fn farthest(&self, found: &[State], truth: &[State]) -> f64 {
        let most = |a: &[State], b: &dyn Fn(usize, usize) -> DVec3| {
            let states = a.iter().enumerate();
            let ways = states.flat_map(|(k, s)| {
                let nodes = s.x.iter().enumerate();
                nodes.map(move |(i, x)| x.distance(b(k, i)))
            });
            ways.fold(0.0, f64::max)
        };
        let rest = self.rest();
        most(found, &|k, i| truth[k].x[i]) / most(truth, &|_, i| rest[i])
    }

    /// Largest errors of energy and volume at a stop, relative.
    fn drifts(&self, found: &[State], truth: &[State]) -> (f64, f64) {
        let (mut energy, mut volume, mut scale) = (0.0_f64, 0.0_f64, 0.0_f64);
        let whole = self.volume(self.rest());
        for (a, b) in found.iter().zip(truth) {
            let (of_a, of_b) = (self.energy(a), self.energy(b));
            energy = energy.max((of_a[0] + of_a[1] - of_b[0] - of_b[1]).abs());
            scale = scale.max(of_b[0]);
            volume = volume.max((self.volume(&a.x) - self.volume(&b.x)).abs() / whole);
        }
        (energy / scale, volume)
    }

    /// Energy of motion and springs, and of the loads, J.
    fn energy(&self, state: &State) -> [f64; 2] {
        let loads = |masses: &mut dyn Iterator<Item = f64>, gravity: DVec3, forces: &[DVec3]| {
            let nodes = state.x.iter().zip(masses).zip(forces);
            let work: f64 = nodes.map(|((x, m), f)| x.dot(m * gravity + *f)).sum();
            -work
        };
        match &self.twin {
            Twin::Tets(start) => {
                let mut p = start.as_ref().clone();
                (p.x, p.v) = (state.x.clone(), state.v.clone());
                let mut masses = p.network.masses.iter().copied();
                let load = loads(&mut masses, p.gravity, &p.external);
                [p.elastic_energy() + p.kinetic_energy(), load]
            }
            Twin::Grid(start) => {
                let mut p = start.as_ref().clone();
                let before = state.x.iter().zip(&state.v);
                p.previous = before.map(|(x, v)| *x - *v).collect();
                p.x = state.x.clone();
                let [kinetic, elastic] = p.energy(1.0);
                let inverse = p.inverse_masses.iter();
                let mut masses = inverse.map(|w| if *w > 0.0 { 1.0 / w } else { 0.0 });
                [kinetic + elastic, loads(&mut masses, p.gravity, &p.forces)]
            }
        }
    }

    fn volume(&self, x: &[DVec3]) -> f64 {
        let tets = self.simulator.mesh().tets.iter();
        tets.map(|t| signed_volume(t.map(|v| x[v as usize]))).sum()
    }
}
