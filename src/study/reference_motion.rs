//! Motions in float64 on the CPU engine, and their limit for vanishing steps, the reference for the
//! error of every solver.

use crate::physics::{CgSettings, Simulator, SolverKind};
use crate::{Error, Result};
use glam::DVec3;

/// A body farther than this from its start, in multiples of its size, has diverged.
const FARTHEST: f64 = 1e4;

/// Positions and velocities of a body.
#[derive(Clone, Debug)]
pub struct MotionState {
    /// Positions, m, from the origin of its frame.
    pub x: Vec<DVec3>,
    /// Velocities, m/s.
    pub v: Vec<DVec3>,
}

impl MotionState {
    /// Returns the rest state.
    pub fn rest(simulator: &dyn Simulator) -> MotionState {
        let (frame, unit) = simulator.loads().frame_and_unit();
        let rest = simulator.mesh().nodes.iter();
        let x: Vec<DVec3> = rest.map(|p| (*p - frame.origin) * unit).collect();
        MotionState {
            v: vec![DVec3::ZERO; x.len()],
            x,
        }
    }

    /// Returns the current state of `simulator`.
    ///
    /// # Errors
    /// An error if reading back fails.
    pub fn from_simulator(simulator: &dyn Simulator) -> Result<MotionState> {
        let (frame, unit) = simulator.loads().frame_and_unit();
        let (x, v) = (simulator.positions()?, simulator.velocities()?);
        Ok(MotionState {
            x: x.iter().map(|x| (*x - frame.origin) * unit).collect(),
            v: v.iter().map(|v| *v * unit).collect(),
        })
    }

    /// Sets `simulator` to this state.
    ///
    /// # Errors
    /// As [`Simulator::set_positions`].
    pub fn apply_to(&self, simulator: &mut dyn Simulator) -> Result<()> {
        let (frame, unit) = simulator.loads().frame_and_unit();
        let x: Vec<DVec3> = self.x.iter().map(|x| *x / unit + frame.origin).collect();
        let v: Vec<DVec3> = self.v.iter().map(|v| *v / unit).collect();
        simulator.set_positions(&x)?;
        simulator.set_velocities(&v)
    }
}

/// A solver and the stopping criteria of its linear solves.
pub(crate) type Scheme = (SolverKind, CgSettings);

impl ReferenceMotion {
    /// Returns the solver `kind` with linear systems solved to float64 accuracy.
    pub fn converged_scheme(kind: SolverKind) -> Scheme {
        let settings = CgSettings {
            tolerance: 1e-12,
            max_iterations: 20_000,
            acceptable: 1e-9,
        };
        (kind, settings)
    }

    /// Returns the states of `simulator`, which begins at `start`, after each of `stops` equal
    /// intervals of `duration` seconds in total, with `steps` steps per interval; `None` if the body
    /// diverges.
    ///
    /// # Errors
    /// An error if the simulator fails.
    pub fn simulate(
        simulator: &mut dyn Simulator,
        start: &MotionState,
        (kind, settings): Scheme,
        duration: f64,
        [stops, steps]: [u32; 2],
    ) -> Result<Option<Vec<MotionState>>> {
        let h = duration / f64::from(stops) / f64::from(steps);
        let limit = FARTHEST * reach(&start.x);
        simulator.set_integrator(kind, settings)?;
        start.apply_to(simulator)?;
        let mut states = Vec::new();
        for _ in 0..stops {
            match simulator.run(steps, h) {
                Ok(_) => states.push(MotionState::from_simulator(simulator)?),
                Err(Error::Solver { .. }) => return Ok(None),
                Err(error) => return Err(error),
            }
        }
        let sound = |x: &DVec3| x.is_finite() && x.abs().max_element() < limit;
        let all = states.iter().all(|s| s.x.iter().all(sound));
        Ok(all.then_some(states))
    }
}

fn reach(x: &[DVec3]) -> f64 {
    let (low, high) = crate::mesh::bounds(x);
    (high - low).max_element()
}

impl MotionState {
    /// √ΣΣ|x − y|² over the nodes of all states, m.
    pub fn distance(a: &[MotionState], b: &[MotionState]) -> f64 {
        let squares = a.iter().zip(b).flat_map(|(a, b)| {
            let nodes = a.x.iter().zip(&b.x);
            nodes.map(|(x, y)| x.distance_squared(*y))
        });
        squares.sum::<f64>().sqrt()
    }
}

/// A motion converged under step refinement.
#[derive(Clone, Debug)]
pub struct ReferenceMotion {
    /// Its states, Richardson-extrapolated from the two smallest steps.
    pub states: Vec<MotionState>,
    /// Effect of each halving of the step, the largest step first.
    pub halvings: Vec<Halving>,
}

/// Relative change of the motion when the step is halved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halving {
    /// Steps between two stops before halving.
    pub steps: u32,
    /// |x(h) − x(h/2)|.
    pub change: f64,
    /// |X(2h) − X(h)| of the Richardson extrapolation X(h) = x(h/2) + (x(h/2) − x(h))/3; NaN for
    /// the first halving.
    pub extrapolated: f64,
}

impl ReferenceMotion {
    /// Computes the limit of a second-order scheme for small steps; `run` takes the number of steps
    /// between two stops. Starting from `steps`, the step is halved until the Richardson extrapolation
    /// changes by less than `tolerance` of `scale` (m), or until `most` steps. `None` if no two steps
    /// gave a motion.
    ///
    /// # Errors
    /// As `run`.
    pub fn new(
        steps: u32,
        most: u32,
        tolerance: f64,
        scale: f64,
        mut run: impl FnMut(u32) -> Result<Option<Vec<MotionState>>>,
    ) -> Result<Option<ReferenceMotion>> {
        let mut steps = steps.max(1);
        let mut coarse = run(steps)?;
        let mut truth: Option<ReferenceMotion> = None;
        while steps <= most / 2 {
            let fine = run(2 * steps)?;
            if let (Some(a), Some(b)) = (&coarse, &fine) {
                let states = extrapolate(a, b);
                let known = truth.take();
                let extrapolated = known.as_ref().map_or(f64::NAN, |t| {
                    MotionState::distance(&t.states, &states) / scale
                });
                let mut halvings = known.map_or(Vec::new(), |t| t.halvings);
                halvings.push(Halving {
                    steps,
                    change: MotionState::distance(a, b) / scale,
                    extrapolated,
                });
                truth = Some(ReferenceMotion { states, halvings });
                if extrapolated < tolerance {
                    break;
                }
            }
            coarse = fine;
            steps *= 2;
        }
        Ok(truth)
    }
}

fn extrapolate(coarse: &[MotionState], fine: &[MotionState]) -> Vec<MotionState> {
    let better = |a: &[DVec3], b: &[DVec3]| -> Vec<DVec3> {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| *b + (*b - *a) / 3.0).collect()
    };
    let states = coarse.iter().zip(fine);
    states
        .map(|(a, b)| MotionState {
            x: better(&a.x, &b.x),
            v: better(&a.v, &b.v),
        })
        .collect()
}

impl ReferenceMotion {
    /// Returns the exponent p of y ~ xᵖ: the least-squares slope of the logarithms of the points.
    /// Points that are not positive are omitted; NaN for fewer than two points.
    pub fn fitted_order(points: &[[f64; 2]]) -> f64 {
        let logs: Vec<[f64; 2]> = points
            .iter()
            .map(|p| p.map(f64::ln))
            .filter(|p| p.iter().all(|c| c.is_finite()))
            .collect();
        let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / logs.len() as f64;
        let (x, y) = (mean(0), mean(1));
        let up: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
        let along: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
        up / along
    }
}
