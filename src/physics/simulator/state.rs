//! The state of a simulator, whose content only the engine knows that made it.

use crate::{Error, Result};
use std::any::Any;
use std::fmt;

/// The state of a [`Simulator`](super::Simulator): see
/// [`Checkpointing::state`](super::checkpoint::Checkpointing::state).
///
/// It holds the state type of one engine. Checkpoints store it with a number for that type.
pub struct SimulatorState(Box<dyn EngineState>);

impl SimulatorState {
    /// Wraps the state of one engine.
    pub(crate) fn new<S: EngineState>(state: S) -> SimulatorState {
        SimulatorState(Box::new(state))
    }

    /// Returns the state as the type of one engine; `None` if another type made it.
    pub(crate) fn get<S: EngineState>(&self) -> Option<&S> {
        self.0.as_any().downcast_ref()
    }

    /// Returns the state as the type of one engine.
    ///
    /// # Errors
    /// [`Error::Input`] if another type made it.
    pub(crate) fn expect<S: EngineState>(&self) -> Result<&S> {
        self.get().ok_or_else(|| {
            Error::Input("the saved state is of another kind of body or another engine".into())
        })
    }
}

impl Clone for SimulatorState {
    fn clone(&self) -> SimulatorState {
        self.0.clone_state()
    }
}

impl PartialEq for SimulatorState {
    fn eq(&self, other: &SimulatorState) -> bool {
        self.0.equals(other)
    }
}

impl fmt::Debug for SimulatorState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// What the state type of an engine provides; every type with these traits does.
pub(crate) trait EngineState: Any + fmt::Debug + Send + Sync {
    /// The state, for a conversion to its type.
    fn as_any(&self) -> &dyn Any;

    /// Returns a copy.
    fn clone_state(&self) -> SimulatorState;

    /// Whether `other` is of the same type and equal.
    fn equals(&self, other: &SimulatorState) -> bool;
}

impl<S: Any + Clone + PartialEq + fmt::Debug + Send + Sync> EngineState for S {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn clone_state(&self) -> SimulatorState {
        SimulatorState::new(self.clone())
    }

    fn equals(&self, other: &SimulatorState) -> bool {
        other.get() == Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn state_is_read_as_the_type_that_made_it_only() {
        let state = SimulatorState::new(vec![1u32]);
        assert_eq!(state.get(), Some(&vec![1u32]));
        assert!(state.expect::<String>().is_err());
        assert_eq!(state, state.clone());
        assert_ne!(state, SimulatorState::new(vec![2u32]));
        assert_ne!(state, SimulatorState::new(1u32));
    }
}
