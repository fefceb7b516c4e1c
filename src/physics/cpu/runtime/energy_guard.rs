//! When a step is refused, and what is noted of one that is not. The twin of
//! `shaders/physics/check.wgsl`.

use crate::physics::model::messages::TOOLS_OVERCONSTRAINED_MESSAGE;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How often its energy at the start and the work done since a body may have. Near the limit of
/// stability the energy of a stable explicit scheme swings by up to 39; an instability passes any
/// factor.
pub const ENERGY_FACTOR: f64 = 50.0;

/// Energy, of one node in local units, below which nothing is called a runaway: rounding.
pub const ENERGY_FLOOR: f64 = 1e-9;

/// Why a step was refused. The body stands as it stood before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// A step length that is not positive, or nothing in the body's own time.
    BadStep {
        /// It, in seconds.
        h: f64,
    },
    /// A position, velocity or force is no longer a finite number.
    NonFinite,
    /// The energy is more than [`ENERGY_FACTOR`] times what there was and came in.
    RunawayEnergy {
        /// What the body began with, J.
        baseline: f64,
        /// What it was given since, J.
        work: f64,
    },
    /// Particles of a grid flew farther apart than any load would take them.
    Diverged,
    /// Conjugate gradients ended above the residual that is acceptable.
    NotConverged {
        /// Iterations there were.
        iterations: u32,
        /// The relative residual they came to.
        residual: f64,
    },
    /// Tools press so hard that points of the boundary stayed inside them.
    ToolPenetration,
    /// Parts of the body press so hard on each other that they would go through.
    SelfContactBlocked,
}

impl fmt::Display for StepFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StepFailure::BadStep { h } => write!(
                f,
                "a time step of {h} s makes no sense for this body; give a positive number of seconds"
            ),
            StepFailure::NonFinite => {
                f.write_str("a position, velocity or force is no longer a finite number")
            }
            StepFailure::RunawayEnergy { baseline, work } => write!(
                f,
                "the energy runs away: more than {ENERGY_FACTOR} times what the body began with ({baseline:.3e} J) and was given since ({work:.3e} J)"
            ),
            StepFailure::Diverged => f.write_str("particles flew apart"),
            StepFailure::ToolPenetration => f.write_str(TOOLS_OVERCONSTRAINED_MESSAGE),
            StepFailure::SelfContactBlocked => f.write_str(
                "parts of the body are pressed so hard against each other that they would go through; leave them more room, or move what is moved less far or more slowly",
            ),
            StepFailure::NotConverged {
                iterations,
                residual,
            } => write!(
                f,
                "conjugate gradients came to a relative residual of only {residual:.1e} in {iterations} iterations"
            ),
        }
    }
}

/// What is added up over a state, in local units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepTotals {
    /// Energy of motion.
    pub kinetic: f64,
    /// Energy of the terms.
    pub elastic: f64,
    /// Power of gravity, forces and springs to targets.
    pub power: f64,
    /// Zero, or not a number where anything is not finite.
    pub non_finite: f64,
}

/// What the rule against runaways remembers, in local units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyGuard {
    /// Energy at the start.
    pub baseline: f64,
    /// |Work| done since.
    pub work: f64,
    /// Sums of the last sound state.
    pub last: StepTotals,
}

impl EnergyGuard {
    /// Takes the energy of a state that was put there from outside for the start.
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

    /// Takes note of a state that no energy is judged of.
    ///
    /// # Errors
    /// [`StepFailure::NonFinite`].
    pub fn check_finite(&mut self, sums: StepTotals) -> Result<(), StepFailure> {
        finite(sums)?;
        self.last = sums;
        Ok(())
    }

    /// Judges the state that a step of length `h` led to, of `nodes` nodes; all in local units,
    /// `joules` in one of energy.
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
