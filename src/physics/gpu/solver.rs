//! The common interface of the solvers on the GPU.

use crate::Result;
use crate::gpu::Recorder;
use crate::physics::{GpuBody, SolverKind, SolverState, StepProgress, StepRecord};

/// A time integrator bound to one body.
///
/// Recorded steps run without waiting for the CPU. When a step fails, the body keeps the state
/// before that step and all later steps do nothing; [`Solver::poll`] and [`Solver::run`] then
/// return the error, and the body can still be read and drawn. Changing the body's state, loads or
/// pins clears a failure.
pub trait Solver: Send {
    /// The kind of solver.
    fn kind(&self) -> SolverKind;

    /// Records `steps` steps of `dt` seconds, after waiting for those requested by
    /// [`Solver::advance`]. The recording must be submitted before `body` is changed; long runs
    /// should be split (see [`Solver::run`]). An implicit step is given the iterations of the
    /// latest known step plus a margin, or at least 64 if loads have changed since; a step that
    /// needs more continues with those of the next recorded step, whose number is doubled.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the step is not positive, or the body is not that
    /// of the solver; otherwise an error if the device rejects the work.
    fn record(
        &mut self,
        work: &mut Recorder,
        body: &mut GpuBody,
        steps: u32,
        dt: f64,
    ) -> Result<()>;

    /// Submits one step of `dt` seconds without waiting for it.
    ///
    /// # Errors
    /// As [`Solver::record`].
    fn step(&mut self, body: &mut GpuBody, dt: f64) -> Result<()> {
        let mut work = body.gpu.start_recording();
        self.record(&mut work, body, 1, dt)?;
        work.submit()
    }

    /// Requests `steps` more steps of `dt` seconds and submits as many as are safe from driver
    /// timeouts, without waiting. [`Solver::progress`] and [`Solver::finish`] submit the rest.
    ///
    /// # Errors
    /// As [`Solver::record`].
    fn advance(&mut self, body: &mut GpuBody, steps: u32, dt: f64) -> Result<()>;

    /// Returns the known progress of the steps requested by [`Solver::advance`], without waiting;
    /// `None` before any result has arrived. Submits more steps when the last ones are done.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if a step failed; the remaining steps are dropped.
    fn progress(&mut self, body: &mut GpuBody) -> Result<Option<StepProgress>>;

    /// Waits for all steps requested by [`Solver::advance`].
    ///
    /// # Errors
    /// As [`Solver::progress`].
    fn finish(&mut self, body: &mut GpuBody) -> Result<StepProgress>;

    /// Runs `steps` steps of `dt` seconds and waits for them.
    ///
    /// # Errors
    /// As [`Solver::advance`] and [`Solver::finish`].
    fn run(&mut self, body: &mut GpuBody, steps: u32, dt: f64) -> Result<StepProgress> {
        self.advance(body, steps, dt)?;
        self.finish(body)
    }

    /// Waits for submitted steps and returns the progress.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if a step failed: solver, step, time, cause and
    /// advice.
    fn poll(&mut self, body: &GpuBody) -> Result<StepProgress>;

    /// Reads back the solver's own state, without that of its body, after the steps of a
    /// [`Solver::run`].
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn state(&self) -> Result<SolverState>;

    /// Restores a state from [`Solver::state`] of this solver, or of one created in the same
    /// manner. The state of `body` must be restored by [`GpuBody::set_state`] before.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the state is of another solver.
    fn set_state(&mut self, body: &GpuBody, state: &SolverState) -> Result<()>;

    /// Reads back iterations, residual and energies of the latest steps (at most 1,024), oldest
    /// first.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn history(&self, body: &GpuBody) -> Result<Vec<StepRecord>>;
}
