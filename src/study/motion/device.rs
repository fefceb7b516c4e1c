//! The motions of a trial on the GPU: run, timed, read back.

use super::trial::{STOPS, Setting, Subject};
use crate::gpu::Gpu;
use crate::physics::grid::GridBody;
use crate::physics::{Body, ConjugateGradients, ImplicitEuler, Solver, SolverKind};
use crate::reference::springs::Particles;
use crate::reference::truth::State;
use crate::{Error, Result};
use glam::DVec3;
use std::time::Instant;

/// A residual that is taken whatever it is.
const ANY: f64 = 1e6;

/// Runs of less than this many milliseconds are repeated, and the fastest counts.
const SHORT: f64 = 100.0;

/// What a motion came to that ran to its end, until it is compared.
pub const ACCURATE: &str = "accurate";

/// What became of a motion on the GPU.
pub struct Outcome {
    /// [`ACCURATE`] until it is compared, or how it failed.
    pub state: &'static str,
    /// The states at the stops.
    pub states: Vec<State>,
    /// Milliseconds for all of it.
    pub ms: f64,
    /// Iterations a step.
    pub iterations: f64,
}

/// Moves `subject` from its start in steps of `h` seconds, timed, after a step that makes
/// everything ready.
///
/// # Errors
/// What the device refuses; a motion that fails is an outcome.
pub fn on_gpu(gpu: &Gpu, subject: &mut Subject, setting: Setting, h: f64) -> Result<Outcome> {
    match subject {
        Subject::Tets(body, start) => {
            let mut solver = solver(gpu, body, setting)?;
            let reset = |body: &mut Body| put(body, start);
            reset(body)?;
            if let Some(failed) = failure(solver.run(body, 1, h).map(|_| ()))? {
                return Ok(failed);
            }
            let mut outcome = timed(
                body.as_mut(),
                reset,
                |body, steps| solver.run(body, steps, h).map(|_| ()),
                state_of,
                setting.steps,
            )?;
            let history = solver.history(body)?;
            let sum: u32 = history.iter().map(|s| s.iterations).sum();
            outcome.iterations = f64::from(sum) / history.len().max(1) as f64;
            Ok(outcome)
        }
        Subject::Grid(body, start) => {
            let frame = body.model().frame;
            let unit = body.model().length_unit;
            let rest: Vec<DVec3> = start.x.iter().map(|x| *x / unit + frame.origin).collect();
            let reset = |body: &mut GridBody| body.set_positions(&rest);
            reset(body)?;
            if let Some(failed) = failure(body.run(1, h))? {
                return Ok(failed);
            }
            let read = |body: &GridBody| -> Result<State> {
                let x = body.positions()?;
                let v = body.velocities()?;
                Ok(State {
                    x: x.iter().map(|x| (*x - frame.origin) * unit).collect(),
                    v: v.iter().map(|v| *v * unit).collect(),
                })
            };
            timed(
                body.as_mut(),
                reset,
                |body, steps| body.run(steps, h),
                read,
                setting.steps,
            )
        }
    }
}

fn solver(gpu: &Gpu, body: &Body, setting: Setting) -> Result<Box<dyn Solver>> {
    let (SolverKind::Implicit, Some((tolerance, iterations))) = (setting.kind, setting.cg) else {
        return setting.kind.solver(gpu, body);
    };
    let default = ConjugateGradients::default();
    let settings = ConjugateGradients {
        tolerance,
        max_iterations: iterations,
        acceptable: match iterations < default.max_iterations {
            true => ANY,
            false => default.acceptable.max(tolerance),
        },
    };
    Ok(Box::new(ImplicitEuler::with(gpu, body, settings)?))
}

/// Puts a body where its twin starts.
fn put(body: &mut Body, start: &Particles) -> Result<()> {
    let network = &start.network;
    let x: Vec<DVec3> = start.x.iter().map(|x| network.to_file(*x)).collect();
    let unit = network.length_unit;
    let v: Vec<DVec3> = start.v.iter().map(|v| *v / unit).collect();
    body.set_positions(&x)?;
    body.set_velocities(&v)
}

fn state_of(body: &Body) -> Result<State> {
    let network = body.network();
    let x = body.positions()?;
    let v = body.velocities()?;
    Ok(State {
        x: x.iter().map(|x| network.to_metres(*x)).collect(),
        v: v.iter().map(|v| *v * network.length_unit).collect(),
    })
}

/// The outcome of a run that failed, if it did.
fn failure(result: Result<()>) -> Result<Option<Outcome>> {
    match result {
        Ok(()) => Ok(None),
        Err(Error::Solver { what, .. }) => Ok(Some(Outcome {
            state: match what.starts_with("conjugate gradients") {
                true => "cg not converged",
                false => "diverged",
            },
            states: Vec::new(),
            ms: f64::NAN,
            iterations: f64::NAN,
        })),
        Err(error) => Err(error),
    }
}

/// Runs from stop to stop, reading the state at each outside of the time; short runs thrice.
fn timed<B>(
    body: &mut B,
    reset: impl Fn(&mut B) -> Result<()>,
    mut run: impl FnMut(&mut B, u32) -> Result<()>,
    read: impl Fn(&B) -> Result<State>,
    steps: u32,
) -> Result<Outcome> {
    let mut outcome = Outcome {
        state: ACCURATE,
        states: Vec::new(),
        ms: f64::INFINITY,
        iterations: f64::NAN,
    };
    for _ in 0..3 {
        reset(body)?;
        let mut ms = 0.0;
        outcome.states.clear();
        for _ in 0..STOPS {
            let start = Instant::now();
            let result = run(body, steps);
            ms += start.elapsed().as_secs_f64() * 1e3;
            if let Some(failed) = failure(result)? {
                return Ok(failed);
            }
            outcome.states.push(read(body)?);
        }
        outcome.ms = outcome.ms.min(ms);
        if ms > SHORT {
            break;
        }
    }
    Ok(outcome)
}
