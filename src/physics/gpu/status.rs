//! Step status and history written by the GPU, and their evaluation on the CPU. The CPU side of
//! `shaders/lib/status.wgsl`.

use crate::physics::model::units::LocalUnits;
use crate::physics::simulator::messages::{INVERTED_TETS_MESSAGE, TOOLS_OVERCONSTRAINED_MESSAGE};
use crate::physics::{GpuBody, SolverKind, StepProgress, StepRecord, time_step_advice};
use crate::{Error, FailureCause};

/// Number of steps in the history ring.
pub(in crate::physics) const HISTORY: u32 = 1024;

pub(in crate::physics) mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/lib/status.wgsl`.
        pub struct Status {
            pub failed: u32,
            pub solving: u32,
            pub accepted: u32,
            pub steps: u32,
            pub iterations: u32,
            pub residual: f32,
            pub baseline: f32,
            pub work: f32,
            pub kinetic: f32,
            pub elastic: f32,
            pub inverted: u32,
            pub _pad0: u32,
        }
    }
}
use gpu_data::Status;

const NON_FINITE: u32 = 1;
const RUNAWAY_ENERGY: u32 = 2;
/// Message for tools that the body cannot yield to.
const EXCESS_PENETRATION: u32 = 4;
const INVERTED_TETS: u32 = 5;

impl StepRecord {
    pub(in crate::physics) fn of_gpu(noted: [f32; 4], units: &LocalUnits) -> StepRecord {
        StepRecord {
            iterations: noted[0] as u32,
            residual: f64::from(noted[1]),
            kinetic: f64::from(noted[2]) * units.energy(),
            elastic: f64::from(noted[3]) * units.energy(),
        }
    }
}

/// Recorded steps and their lengths, to convert a step count to time.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::physics) struct Clock {
    /// Numbers of steps and their length, oldest first.
    runs: Vec<(u64, f64)>,
    /// Number of steps and time before `runs`.
    past: (u64, f64),
    /// Number of completed steps; the GPU counts its lower 32 bits.
    completed: u64,
}

impl Clock {
    pub fn record(&mut self, steps: u32, dt: f64) {
        match self.runs.last_mut() {
            Some((n, same)) if *same == dt => *n += u64::from(steps),
            _ => self.runs.push((u64::from(steps), dt)),
        }
    }

    /// Updates the completed count from the GPU's counter.
    pub fn complete(&mut self, count: u32) {
        self.completed += u64::from(count.wrapping_sub(self.completed as u32));
        while let Some((steps, dt)) = self.runs.first().copied()
            && self.runs.len() > 1
            && self.past.0 + steps <= self.completed
        {
            self.past = (self.past.0 + steps, self.past.1 + steps as f64 * dt);
            self.runs.remove(0);
        }
    }

    /// Drops recorded steps that will not be executed.
    pub fn rebase(&mut self) {
        self.past = (self.completed, self.time());
        let dt = self.dt();
        self.runs = vec![(0, dt)];
    }

    /// Whether the values are consistent; they may come from a file.
    pub fn is_valid(&self) -> bool {
        let total = self
            .runs
            .iter()
            .try_fold(self.past.0, |n, r| n.checked_add(r.0));
        self.past.0 <= self.completed && total.is_some_and(|n| n >= self.completed)
    }

    pub fn steps(&self) -> u64 {
        self.completed
    }

    /// Step count after all recorded steps.
    pub fn recorded(&self) -> u64 {
        self.past.0 + self.runs.iter().map(|run| run.0).sum::<u64>()
    }

    pub fn time(&self) -> f64 {
        let (mut steps, mut time) = self.past;
        for (n, dt) in &self.runs {
            let done = (*n).min(self.completed - steps);
            steps += done;
            time += done as f64 * dt;
        }
        time
    }

    pub fn dt(&self) -> f64 {
        self.runs.last().map_or(0.0, |r| r.1)
    }
}

impl Status {
    pub fn progress(&self, clock: &Clock, units: &LocalUnits) -> StepProgress {
        let noted = [
            self.iterations as f32,
            self.residual,
            self.kinetic,
            self.elastic,
        ];
        StepProgress {
            steps: clock.steps(),
            time: clock.time(),
            last: StepRecord::of_gpu(noted, units),
        }
    }

    /// The error that the GPU recorded, if any.
    pub fn error(&self, kind: SolverKind, clock: &Clock, body: &GpuBody) -> Option<Error> {
        if self.failed == 0 {
            return None;
        }
        let cause = match self.failed {
            NON_FINITE => FailureCause::NotFinite,
            RUNAWAY_ENERGY => FailureCause::RunawayEnergy,
            INVERTED_TETS => FailureCause::InvertedTets,
            _ => FailureCause::NotConverged,
        };
        let what = match self.failed {
            NON_FINITE => "a position, velocity or force is no longer finite".to_owned(),
            RUNAWAY_ENERGY => format!(
                "the energy diverges: more than {ENERGY_FACTOR} times the sum of the initial energy ({:.3e} J) and the work done since ({:.3e} J)",
                f64::from(self.baseline) * body.units.energy(),
                f64::from(self.work) * body.units.energy()
            ),
            EXCESS_PENETRATION => TOOLS_OVERCONSTRAINED_MESSAGE.to_owned(),
            INVERTED_TETS => INVERTED_TETS_MESSAGE.to_owned(),
            _ => format!(
                "conjugate gradients reached a relative residual of only {:.1e} in {} iterations",
                self.residual, self.iterations
            ),
        };
        Some(Error::Solver {
            solver: kind.name(),
            step: clock.steps() + 1,
            time: clock.time(),
            cause,
            what,
            advice: time_step_advice(kind, clock.dt(), (&body.model, body.terms()), body.pinned()),
        })
    }
}

/// Maximum energy over the sum of the initial energy and the work done since. Near the stability
/// limit the energy of a stable explicit scheme oscillates: that of symplectic Euler by (2 + hω)/(2
/// − hω), which is 39 at the advised 0.95 of the limit. An instability exceeds any factor.
pub(in crate::physics) const ENERGY_FACTOR: f64 = 50.0;

/// Energy of one node, in local units, below which nothing is treated as a runaway: rounding error.
pub(in crate::physics) const ENERGY_FLOOR: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_time_is_exact_for_any_number_of_steps() {
        let mut clock = Clock::default();
        clock.record(3, 0.5);
        clock.record(2, 0.25);
        clock.complete(2);
        assert_eq!((clock.steps(), clock.time()), (2, 1.0));
        clock.complete(4);
        assert_eq!((clock.steps(), clock.time()), (4, 1.75));
        clock.complete(5);
        assert_eq!(clock.time(), 2.0);
    }
}
