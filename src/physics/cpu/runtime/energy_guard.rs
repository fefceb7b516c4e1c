//! Acceptance checks of a step and the totals they use. The GPU counterpart is
//! `shaders/physics/check.wgsl`.

use crate::FailureCause;
use crate::physics::simulator::messages::{INVERTED_TETS_MESSAGE, TOOLS_OVERCONSTRAINED_MESSAGE};
use crate::physics::simulator::time_step::time_step_message;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Largest allowed ratio of the energy to the initial energy plus the work done since. Near the
/// stability limit the energy of a stable explicit scheme oscillates by a factor of up to 39; an
/// instability exceeds any factor.
pub const ENERGY_FACTOR: f64 = 50.0;

/// Energy per node, local units, below which growth is attributed to rounding.
pub const ENERGY_FLOOR: f64 = 1e-9;

/// Why a step was rejected. The body keeps its state from before the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// The step length is not positive, or vanishes in the body's time unit.
    BadStep {
        /// Step length, s.
        h: f64,
    },
    /// A position, velocity or force is no longer a finite number.
    NonFinite,
    /// The energy exceeds [`ENERGY_FACTOR`] times the initial energy plus the work done.
    RunawayEnergy {
        /// Energy at the start, J.
        baseline: f64,
        /// Work done since, J.
        work: f64,
    },
    /// Particles of a grid moved farther apart than any load would take them.
    Diverged,
    /// Conjugate gradients stopped above the acceptable residual.
    NotConverged {
        /// Iterations performed.
        iterations: u32,
        /// Relative residual reached.
        residual: f64,
    },
    /// The step inverted tets of a body that had none inverted.
    InvertedTets,
    /// Points of the boundary remain inside tools because the tools press too hard.
    ToolPenetration,
    /// Parts of the body press on each other so hard that they would interpenetrate.
    SelfContactBlocked,
}

impl StepFailure {
    /// The cause as errors state it.
    pub fn cause(&self) -> FailureCause {
        match self {
            StepFailure::RunawayEnergy { .. } => FailureCause::RunawayEnergy,
            StepFailure::Diverged => FailureCause::FlownApart,
            StepFailure::InvertedTets => FailureCause::InvertedTets,
            StepFailure::NotConverged { .. }
            | StepFailure::ToolPenetration
            | StepFailure::SelfContactBlocked => FailureCause::NotConverged,
            StepFailure::BadStep { .. } | StepFailure::NonFinite => FailureCause::NotFinite,
        }
    }
}

impl fmt::Display for StepFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StepFailure::BadStep { h } => f.write_str(&time_step_message(*h)),
            StepFailure::NonFinite => {
                f.write_str("a position, velocity or force is no longer finite")
            }
            StepFailure::RunawayEnergy { baseline, work } => write!(
                f,
                "the energy diverges: more than {ENERGY_FACTOR} times the sum of the initial energy ({baseline:.3e} J) and the work done since ({work:.3e} J)"
            ),
            StepFailure::Diverged => f.write_str("particles diverged"),
            StepFailure::InvertedTets => f.write_str(INVERTED_TETS_MESSAGE),
            StepFailure::ToolPenetration => f.write_str(TOOLS_OVERCONSTRAINED_MESSAGE),
            StepFailure::SelfContactBlocked => f.write_str(
                "parts of the body are pressed so hard against each other that they would interpenetrate; increase the clearance, or make prescribed motions shorter or slower",
            ),
            StepFailure::NotConverged {
                iterations,
                residual,
            } => write!(
                f,
                "conjugate gradients reached a relative residual of only {residual:.1e} in {iterations} iterations"
            ),
        }
    }
}

/// Totals over a state, in local units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepTotals {
    /// Kinetic energy.
    pub kinetic: f64,
    /// Potential energy of the terms.
    pub elastic: f64,
    /// Power of gravity, forces and target springs.
    pub power: f64,
    /// 0, or NaN if any value is not finite.
    pub non_finite: f64,
}

/// Energy balance for detecting runaway energy, in local units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyGuard {
    /// Energy at the start.
    pub baseline: f64,
    /// |Work| done since.
    pub work: f64,
    /// Totals of the last accepted state.
    pub last: StepTotals,
}

impl EnergyGuard {
    /// Restarts the energy balance from a state set from outside.
    ///
    /// # Errors
    /// [`StepFailure::NonFinite`].
    pub fn restart(&mut self, sums: StepTotals) -> Result<(), StepFailure> {
        finite(sums)?;
        *self = EnergyGuard {
            baseline: sums.kinetic + sums.elastic,
            work: 0.0,
            last: sums,
        };
        Ok(())
    }

    /// Records a state without checking its energy.
    ///
    /// # Errors
    /// [`StepFailure::NonFinite`].
    pub fn check_finite(&mut self, sums: StepTotals) -> Result<(), StepFailure> {
        finite(sums)?;
        self.last = sums;
        Ok(())
    }

    /// Checks the state after a step of length `h` of `nodes` nodes; all in local units, with an
    /// energy unit of `joules`.
    ///
    /// # Errors
    /// [`StepFailure::NonFinite`], [`StepFailure::RunawayEnergy`].
    pub fn check_step(
        &mut self,
        sums: StepTotals,
        h: f64,
        nodes: usize,
        joules: f64,
    ) -> Result<(), StepFailure> {
        finite(sums)?;
        let work = (sums.power * h).abs();
        let floor = ENERGY_FLOOR * nodes as f64;
        let allowed = self.baseline + self.work + work + floor;
        if sums.kinetic + sums.elastic > ENERGY_FACTOR * allowed {
            return Err(StepFailure::RunawayEnergy {
                baseline: self.baseline * joules,
                work: self.work * joules,
            });
        }
        self.work += work;
        self.last = sums;
        Ok(())
    }
}

fn finite(sums: StepTotals) -> Result<(), StepFailure> {
    let all = sums.kinetic + sums.elastic + sums.power + sums.non_finite;
    match all.is_finite() {
        true => Ok(()),
        false => Err(StepFailure::NonFinite),
    }
}
