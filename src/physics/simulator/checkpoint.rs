//! States of a body that can be saved and restored.

use super::ExactPositions;
use crate::Result;
use crate::physics::SimulatorState;

/// A body whose state can be saved and restored.
pub trait Checkpointing {
    /// Reads back everything that its next steps depend on, after the steps of
    /// [`Simulator::finish`](crate::physics::Simulator::finish); of its topology only what
    /// identifies it.
    ///
    /// # Errors
    /// Errors of reading back.
    fn state(&self) -> Result<SimulatorState>;

    /// Restores a state from [`Checkpointing::state`] of this simulator, or of one created and cut
    /// in the same manner: the following steps are identical.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the state is of another simulator.
    fn set_state(&mut self, state: &SimulatorState) -> Result<()>;

    /// Returns the exact positions (bitwise) that a cut divides.
    ///
    /// # Errors
    /// Errors of reading back.
    fn exact_positions(&self) -> Result<ExactPositions>;

    /// Sets the exact positions at the time of a cut, without velocities.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the positions are of another body.
    fn set_exact_positions(&mut self, pose: &ExactPositions) -> Result<()>;
}
