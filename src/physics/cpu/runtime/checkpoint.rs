//! Checkpoints of bodies stepped on their own threads.

use super::load_sync::full_load_update;
use super::steppable::{Resumable, Steppable};
use super::threaded_simulator::{BodyModel, ThreadedSimulator};
use super::worker::StepClock;
use crate::Result;
use crate::physics::loads::{LoadVersions, LoadsState};
use crate::physics::simulator::checkpoint::Checkpointing;
use crate::physics::simulator::state::EngineState;
use crate::physics::{ExactPositions, SimulatorState, StepProgress};
use serde::{Deserialize, Serialize};

/// A model whose bodies can be saved and restored.
pub(in crate::physics::cpu) trait ResumableModel:
    BodyModel<Body: Resumable>
{
    /// The stored form, a type of its own for every model.
    type State: EngineState + From<ThreadedState> + AsRef<ThreadedState>;

    /// Creates a body of the model as it is now, at rest, partitioned into `parts` chunks.
    ///
    /// # Errors
    /// Errors of creating the body.
    fn rebuild(simulator: &ThreadedSimulator<Self>, parts: usize) -> Result<Box<Self::Body>>;

    /// Returns the exact positions, in the body's own units.
    fn exact_positions(body: &Self::Body) -> Vec<[f64; 3]>;

    /// Sets the exact positions.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if they are of another body.
    fn set_exact_positions(body: &mut Self::Body, positions: &[[f64; 3]]) -> Result<()>;
}

/// The state of a [`ThreadedSimulator`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::physics::cpu) struct ThreadedState {
    /// State of the body, serialised in the body's own precision.
    body: Vec<u8>,
    loads: LoadsState,
    synced_loads: Option<LoadVersions>,
    changes: u64,
    progress: StepProgress,
    span: StepClock,
    /// Number of chunks among which the nodes are partitioned: the rounding of sums depends on it.
    parts: usize,
}

impl<M: ResumableModel> Checkpointing for ThreadedSimulator<M> {
    fn state(&self) -> Result<SimulatorState> {
        let (body, parts) = {
            let body = self.worker.body();
            (body.serialise_state()?, body.parts())
        };
        Ok(SimulatorState::new(M::State::from(ThreadedState {
            body,
            loads: self.loads.state(),
            synced_loads: self.synced_loads,
            changes: self.changes,
            progress: self.progress,
            span: self.worker.span(),
            parts,
        })))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let state: &ThreadedState = state.expect::<M::State>()?.as_ref();
        self.worker.cancel_pending();
        self.loads.set_state(&state.loads)?;
        if self.worker.body().parts() != state.parts {
            let body = M::rebuild(self, state.parts)?;
            *self.worker.body() = body;
        }
        {
            let mut body = self.worker.body();
            body.apply_loads(full_load_update(&self.loads))?;
            body.resume(&state.body)?;
        }
        self.synced_loads = state.synced_loads;
        self.changes = state.changes;
        self.progress = state.progress;
        self.worker.set_progress(state.progress, state.span);
        self.upload_now()
    }

    fn exact_positions(&self) -> Result<ExactPositions> {
        Ok(ExactPositions {
            displacements: M::exact_positions(&**self.worker.body()),
            ..ExactPositions::default()
        })
    }

    fn set_exact_positions(&mut self, pose: &ExactPositions) -> Result<()> {
        M::set_exact_positions(&mut **self.worker.body(), &pose.displacements)?;
        self.upload_now()
    }
}
