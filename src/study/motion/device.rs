//! Timed runs of the motions of a trial on the engine.

use super::setting::MotionSetting;
use super::trial::STOPS;
use crate::physics::{CgSettings, Simulator};
use crate::study::reference_motion::MotionState;
use crate::{Error, FailureCause, Result};
use std::time::Instant;

/// A residual limit that accepts every solve.
const NO_RESIDUAL_LIMIT: f64 = 1e6;

/// Runs shorter than this, in milliseconds, are repeated, and the fastest counts.
const MIN_TIMED_MS: f64 = 100.0;

/// State of a motion that ran to its end but has not been compared yet.
pub const ACCURATE: &str = "accurate";

/// Outcome of a motion.
pub struct Outcome {
    /// [`ACCURATE`] until it is compared, or how it failed.
    pub state: &'static str,
    /// The states at the stops.
    pub states: Vec<MotionState>,
    /// Wall time of the motion, ms.
    pub ms: f64,
    /// Iterations per step.
    pub iterations: f64,
}

/// Moves the body of `simulator` from `start` in steps of `h` seconds and times it, after a warm-up
/// step. For a grid body, `start` must be at rest.
///
/// # Errors
/// An error if the device fails; a motion that fails is an outcome.
pub fn on_engine(
    simulator: &mut dyn Simulator,
    start: &MotionState,
    setting: MotionSetting,
    h: f64,
) -> Result<Outcome> {
    simulator.set_integrator(setting.kind, settings(setting))?;
    let reset = |simulator: &mut dyn Simulator| start.apply_to(simulator);
    reset(simulator)?;
    if let Some(failed) = failure(simulator.run(1, h).map(|_| ()))? {
        return Ok(failed);
    }
    let mut outcome = timed(simulator, reset, setting.steps, h)?;
    let iterations = simulator.iterations()?;
    let sum: u32 = iterations.iter().sum();
    outcome.iterations = f64::from(sum) / iterations.len().max(1) as f64;
    Ok(outcome)
}

fn settings(setting: MotionSetting) -> CgSettings {
    let default = CgSettings::default();
    let Some((tolerance, iterations)) = setting.cg else {
        return default;
    };
    CgSettings {
        tolerance,
        max_iterations: iterations,
        acceptable: match iterations < default.max_iterations {
            true => NO_RESIDUAL_LIMIT,
            false => default.acceptable.max(tolerance),
        },
    }
}

/// Returns the outcome of a failed run, if it failed.
fn failure(result: Result<()>) -> Result<Option<Outcome>> {
    match result {
        Ok(()) => Ok(None),
        Err(Error::Solver { cause, .. }) => Ok(Some(Outcome {
            state: match cause {
                FailureCause::NotConverged => "cg not converged",
                _ => "diverged",
            },
            states: Vec::new(),
            ms: f64::NAN,
            iterations: f64::NAN,
        })),
        Err(error) => Err(error),
    }
}

/// Runs from stop to stop, reading the state at each outside the timed part; short runs are run
/// three times.
fn timed(
    simulator: &mut dyn Simulator,
    reset: impl Fn(&mut dyn Simulator) -> Result<()>,
    steps: u32,
    h: f64,
) -> Result<Outcome> {
    let mut outcome = Outcome {
        state: ACCURATE,
        states: Vec::new(),
        ms: f64::INFINITY,
        iterations: f64::NAN,
    };
    for _ in 0..3 {
        reset(simulator)?;
        let mut ms = 0.0;
        outcome.states.clear();
        for _ in 0..STOPS {
            let start = Instant::now();
            let result = simulator.run(steps, h).map(|_| ());
            ms += start.elapsed().as_secs_f64() * 1e3;
            if let Some(failed) = failure(result)? {
                return Ok(failed);
            }
            outcome.states.push(MotionState::from_simulator(simulator)?);
        }
        outcome.ms = outcome.ms.min(ms);
        if ms > MIN_TIMED_MS {
            break;
        }
    }
    Ok(outcome)
}
