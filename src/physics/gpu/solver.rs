//! What every solver can do.

use crate::Result;
use crate::gpu::Recorder;
use crate::physics::{GpuBody, SolverKind, SolverState, StepProgress, StepRecord};

/// A time integrator bound to one body.
///
/// Recorded steps run without waiting for the CPU. When one of them fails, the body stays as it
/// was before that step and all later steps do nothing; [`Solver::poll`] and [`Solver::run`] then
/// return the error, and the body can still be read and drawn. Changing the body's state,
/// loads or pins clears a failure.
pub trait Solver: Send {
    /// Which solver it is.
    fn kind(&self) -> SolverKind;

    /// Records `steps` steps of `dt` seconds, after waiting for those that [`Solver::advance`] was
    /// asked for. To be submitted before anything of `body` is
    /// changed; long runs are better split (see [`Solver::run`]). An implicit step is given as
    /// many iterations as the latest one known of needed, and some, or at least 64 where something
    /// else acts since; one that needs more goes on
    /// with those of the next step recorded, which are then twice as many.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a step that is not positive or another body than
    /// the solver was made for; otherwise what the device refuses.
    fn record(
        &mut self,
        work: &mut Recorder,
        body: &mut GpuBody,
        steps: u32,
        dt: f64,
    ) -> Result<()>;

    /// Submits one step of `dt` seconds, without waiting for it.
    ///
    /// # Errors
    /// As [`Solver::record`].
    fn step(&mut self, body: &mut GpuBody, dt: f64) -> Result<()> {
        let mut work = body.gpu.start_recording();
        self.record(&mut work, body, 1, dt)?;
        work.submit()
    }

    /// Asks for `steps` more steps of `dt` seconds, and submits as many as no driver takes amiss;
    /// waits for none. [`Solver::progress`] and [`Solver::finish`] submit the rest.
    ///
    /// # Errors
    /// As [`Solver::record`].
    fn advance(&mut self, body: &mut GpuBody, steps: u32, dt: f64) -> Result<()>;

    /// How far the steps asked for by [`Solver::advance`] have come as far as is known, without
    /// waiting; none before anything arrived. Submits more of them where the last were done.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) when a step failed; the steps left are dropped.
    fn progress(&mut self, body: &mut GpuBody) -> Result<Option<StepProgress>>;

    /// Waits for all steps asked for by [`Solver::advance`].
    ///
    /// # Errors
    /// As [`Solver::progress`].
    fn finish(&mut self, body: &mut GpuBody) -> Result<StepProgress>;

    /// Runs `steps` steps of `dt` seconds, and waits for them.
    ///
    /// # Errors
    /// As [`Solver::advance`] and [`Solver::finish`].
    fn run(&mut self, body: &mut GpuBody, steps: u32, dt: f64) -> Result<StepProgress> {
        self.advance(body, steps, dt)?;
        self.finish(body)
    }

    /// Waits for what was submitted, and tells how far it came.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) when a step failed: solver, step, time, what was
    /// found, and what to change.
    fn poll(&mut self, body: &GpuBody) -> Result<StepProgress>;

    /// What the solver goes on from, apart from the state of its body, read back after the steps
    /// of a [`Solver::run`].
    ///
    /// # Errors
    /// What the device refuses.
    fn state(&self) -> Result<SolverState>;

    /// Goes on from a state that [`Solver::state`] gave of this solver, or of one made in the same
    /// way. `body` is its body, put into its own state by [`GpuBody::set_state`] before.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for the state of another solver.
    fn set_state(&mut self, body: &GpuBody, state: &SolverState) -> Result<()>;

    /// Iterations, residual and energies of the latest steps (at most 1,024), oldest first, read
    /// back.
    ///
    /// # Errors
    /// What the device refuses.
    fn history(&self, body: &GpuBody) -> Result<Vec<StepRecord>>;
}
