//! The chain of passes of every solver's step: propose, evaluate, check, commit.

use super::integrator::{Integrator, Stage, Timing};
use super::status::gpu_data::Status;
use super::status::{Clock, HISTORY};
use super::step_resources::{PreparedStep, StepResources};
use crate::gpu::{Gpu, Pass, ReadbackRing, Recorder};
use crate::physics::{GpuBody, Solver, SolverKind, SolverState, StepProgress, StepRecord};
use crate::{Error, Result};
use std::collections::VecDeque;

/// Maximum number of spring visits per submit: well below a second on the slowest GPU.
const MAX_WORK_PER_SUBMIT: f64 = 5e8;

/// Iterations of a linear solve given to a step by [`Solver::record`] until the required number is
/// known.
const DEFAULT_ITERATIONS: u32 = 256;
/// Minimum number of iterations after a change of loads or positions.
const MIN_ITERATIONS_AFTER_CHANGE: u32 = 64;

/// Maximum number of dispatches per submit.
const MAX_DISPATCHES: u32 = 8192;

/// Number of iteration pairs per gate.
const ITERATION_PAIRS_PER_GATE: u32 = 4;

/// A solver: the chain of passes around an integrator, bound to one body. See [`Solver`].
#[derive(Debug)]
pub struct Stepper<S> {
    pub(in crate::physics) core: StepResources,
    pub(in crate::physics) scheme: S,
    pub(in crate::physics) prepared: Option<PreparedStep>,
    pub(in crate::physics) clock: Clock,
    /// Iterations recorded per step.
    pub(in crate::physics) iterations: u32,
    /// Whether steps were recorded since the status was last read.
    pub(in crate::physics) status_stale: bool,
    /// Requested steps that are not done: the step count to reach, and the step length.
    errands: VecDeque<(u64, f64)>,
    /// Pending status readback, of at most one submit.
    ring: ReadbackRing,
    /// The step count after that submit, if the recorded iterations suffice.
    expected: u64,
    /// Progress according to the latest status.
    last: Option<StepProgress>,
    /// Whether `iterations` was adapted to a completed step.
    adapted: bool,
    /// Steps recorded for the caller that the latest status did not include: unfinished, or never
    /// submitted.
    untracked_steps: u32,
    /// The loads on the body when a step was last recorded for the caller: its revision, and the
    /// version of its external forces.
    acted: Option<(u64, u64)>,
    /// The step count from which on the number of iterations under these loads is known.
    settled_from: u64,
}

fn no_status() -> Error {
    Error::Gpu("the status of the simulation is empty".into())
}

/// Records a stage, with `iterations` iterations if it is a loop.
fn record_stage(work: &mut Recorder, prepared: &PreparedStep, stage: &Stage, iterations: u32) {
    let passes = match stage {
        Stage::Passes(passes) => passes,
        Stage::Loop {
            gate,
            rounds,
            between,
        } => {
            let pairs = iterations.div_ceil(2);
            for pair in 0..pairs {
                if pair % ITERATION_PAIRS_PER_GATE == 0 {
                    gate.record(work);
                }
                let last = (pair + 1) % ITERATION_PAIRS_PER_GATE == 0 || pair + 1 == pairs;
                let after = if last { &between[..] } else { &[] };
                for pass in rounds.iter().chain(after) {
                    pass.record(work);
                }
            }
            return;
        }
        Stage::Forces(_) => {
            if let Some(draw) = &prepared.grab_springs {
                draw.record(work);
            }
            &prepared.forces
        }
    };
    for pass in passes {
        pass.record(work);
    }
}

/// The kind of start of a recording.
#[derive(Clone, Copy, PartialEq)]
enum StepStart {
    Restart,
    Change,
    Resume,
}

impl<S: Integrator> Stepper<S> {
    /// A solver for `body`.
    ///
    /// # Errors
    /// [`Error::Gpu`] if its arrays do not fit the device; [`Error::Input`] if the body has rigid
    /// regions and the integrator does not support them.
    pub fn new(gpu: &Gpu, body: &GpuBody) -> Result<Stepper<S>> {
        if body.rigid.is_some() && !S::SUPPORTS_RIGID {
            return Err(Error::Input(format!(
                "{} does not support rigid regions; use --solver implicit, or bdf2 or midpoint on the CPU (--engine cpu)",
                S::NAME
            )));
        }
        let core = StepResources::new(gpu, body)?;
        let scheme = S::new(&core, body)?;
        Ok(Stepper {
            iterations: scheme.max_iterations().min(64),
            core,
            scheme,
            prepared: None,
            clock: Clock::default(),
            status_stale: false,
            errands: VecDeque::new(),
            ring: ReadbackRing::new(gpu, size_of::<Status>() as u64),
            expected: 0,
            last: None,
            adapted: false,
            untracked_steps: 0,
            acted: None,
            settled_from: 0,
        })
    }

    /// Rebuilds the passes if anything they depend on has changed, and records the passes before
    /// the first step.
    fn begin(
        &mut self,
        work: &mut Recorder,
        body: &mut GpuBody,
        dt: f64,
    ) -> Result<(&PreparedStep, StepStart)> {
        let local_dt = Self::check_step(body, dt)?;
        if body.id != self.core.body {
            return Err(Error::Input(
                "a solver can step only the body it was created for; create one solver per body"
                    .into(),
            ));
        }
        body.upload_changes()?;
        if body.generation != self.core.generation {
            self.prepared = None;
            self.core.follow(body)?;
            self.scheme.apply_cut(&self.core, body)?;
        }
        let (revision, gravity) = (body.revision(), body.gravity());
        let known = self.prepared.take();
        let mut start = match &known {
            Some(known) if known.revision.state == revision.state => StepStart::Resume,
            _ => StepStart::Restart,
        };
        // Any change may have removed the cause of a failure.
        let forgive = known.as_ref().is_none_or(|k| k.revision != revision);
        let mut prepared = match known {
            Some(known)
                if known.dt == dt
                    && known.gravity == gravity
                    && known.inversion_allowed == body.inversion_allowed =>
            {
                known
            }
            known => {
                if start == StepStart::Resume {
                    start = StepStart::Change;
                }
                let timing = Timing {
                    dt: local_dt,
                    previous_dt: known.map_or(local_dt, |p| p.local_dt),
                };
                let step = self.scheme.step(&self.core, body, timing)?;
                self.core.prepare(body, step, dt, local_dt)?
            }
        };
        prepared.revision = revision;
        let (versions, grabs, external) = (body.loads.versions, &body.grabs, &body.external);
        if prepared.loads != Some(versions) {
            prepared.loads = Some(versions);
            let candidate = &self.core.next_positions;
            prepared.grab_springs = grabs.grab_springs_pass(&body.gpu, candidate, external)?;
        }
        let state = body.nodes().array();
        if let Some(pass) = grabs.prescribed_positions_pass(&body.gpu, state)? {
            pass.record(work);
        }
        if start == StepStart::Restart {
            for pass in &prepared.step.on_external_change {
                pass.record(work);
            }
        }
        if let Some(pass) = grabs.grab_springs_pass(&body.gpu, state, external)? {
            pass.record(work);
        }
        if forgive {
            prepared.clear_failure.record(work);
        }
        let first: &[Pass] = match start {
            StepStart::Restart => &prepared.restart,
            _ => &prepared.refresh_loads,
        };
        for pass in first {
            pass.record(work);
        }
        Ok((self.prepared.insert(prepared), start))
    }

    pub(in crate::physics) fn record_steps(
        &mut self,
        work: &mut Recorder,
        body: &mut GpuBody,
        steps: u32,
        dt: f64,
        iterations: u32,
    ) -> Result<()> {
        if steps == 0 {
            return Ok(());
        }
        let (prepared, start) = self.begin(work, body, dt)?;
        let first = match start {
            StepStart::Restart => &prepared.step.first_stage_on_restart,
            StepStart::Change => &prepared.step.after_change,
            StepStart::Resume => &None,
        };
        for step in 0..steps {
            let first = first.as_ref().filter(|_| step == 0);
            let rest = prepared.step.stages.iter();
            let stages = first
                .into_iter()
                .chain(rest.skip(usize::from(first.is_some())));
            for stage in stages {
                record_stage(work, prepared, stage, iterations);
            }
            prepared.check.record(work);
            prepared.commit.record(work);
        }
        self.clock.record(steps, dt);
        self.status_stale = true;
        Ok(())
    }

    /// Number of steps that fit one submit.
    fn steps_per_submit(&self, iterations: u32) -> u32 {
        // Three per iteration, plus some before and after, with rigid regions.
        let passes = 20
            + 3 * iterations
            + self.interleaved_passes() * iterations.div_ceil(2 * ITERATION_PAIRS_PER_GATE);
        let visits = 4.0 * f64::from(self.core.texels) * f64::from(3 + iterations);
        let by_visits = (MAX_WORK_PER_SUBMIT / visits) as u32;
        by_visits.min(MAX_DISPATCHES / passes).clamp(1, HISTORY)
    }

    /// Number of passes between every few iterations, as far as known.
    fn interleaved_passes(&self) -> u32 {
        let stages = self.prepared.iter().flat_map(|p| &p.step.stages);
        let between = stages.map(|stage| match stage {
            Stage::Loop { between, .. } => between.len() as u32,
            _ => 0,
        });
        between.sum()
    }

    /// Drops requested steps and pending readbacks.
    pub(in crate::physics) fn clear_pending(&mut self) {
        self.errands.clear();
        self.ring.clear();
        self.last = None;
    }

    /// Validates the step and converts it to local units.
    fn check_step(body: &GpuBody, dt: f64) -> Result<f32> {
        let local_dt = (dt / body.units.time) as f32;
        match dt > 0.0 && dt.is_finite() && local_dt.is_normal() {
            true => Ok(local_dt),
            false => Err(Error::Input(format!(
                "time step must be finite, > 0 and in the range of this body, got {dt} s"
            ))),
        }
    }

    /// Submits as many requested steps as fit, if none are in flight.
    fn submit_pending(&mut self, body: &mut GpuBody) -> Result<()> {
        let Some((end, dt)) = self.errands.front().copied() else {
            return Ok(());
        };
        if self.ring.in_flight() > 0 {
            return Ok(());
        }
        let before = self.clock.steps();
        let left = end.saturating_sub(before).min(u64::from(HISTORY)) as u32;
        let chunk = left.min(self.steps_per_submit(self.iterations));
        let mut work = self.core.gpu.start_recording();
        self.record_steps(&mut work, body, chunk, dt, self.iterations)?;
        self.expected = before + u64::from(chunk);
        self.ring.submit(work, &self.core.status)
    }

    /// Processes status readbacks that have arrived.
    fn collect_status(&mut self, body: &GpuBody, wait: bool) -> Result<()> {
        let Some(noted) = self.ring.next_completed::<Status>(wait)? else {
            return Ok(());
        };
        let status = noted.first().ok_or_else(no_status)?;
        self.clock.complete(status.steps);
        self.status_stale = false;
        let failed = status.error(S::KIND, &self.clock, body);
        self.clock.rebase();
        if let Some(error) = failed {
            self.errands.clear();
            return Err(error);
        }
        self.last = Some(status.progress(&self.clock, &body.units));
        self.adapt_iterations(status.iterations, self.clock.steps() == self.expected);
        let done = self.clock.steps();
        while self
            .errands
            .pop_front_if(|errand| errand.0 <= done)
            .is_some()
        {}
        Ok(())
    }

    /// Waits for the status and reads it back.
    fn read_status(&mut self) -> Result<Status> {
        let noted: Vec<Status> = self.core.gpu.read_buffer(&self.core.status)?;
        let status = noted.first().ok_or_else(no_status)?;
        self.clock.complete(status.steps);
        self.status_stale = false;
        Ok(*status)
    }

    /// Decreases the number of iterations if the latest step needed fewer, increases it if they ran
    /// out.
    fn adapt_iterations(&mut self, needed: u32, completed: bool) {
        let most = self.scheme.max_iterations();
        if most > 0 {
            let wanted = if completed {
                needed + needed / 4 + 4
            } else {
                2 * self.iterations
            };
            self.iterations = wanted.clamp(1, most);
            self.adapted = true;
        }
    }

    /// Number of iterations given to each of `steps` steps recorded for the caller: those of the
    /// latest known step plus a margin; more if the loads have changed since.
    fn recorded_iterations(&mut self, body: &GpuBody, steps: u32) -> Result<u32> {
        let acts = Some((body.revision().any, body.external.version()));
        if self.acted != acts {
            self.acted = acts;
            self.settled_from = self.clock.recorded() + u64::from(steps);
        }
        if let Some((expected, noted)) = self.ring.latest::<Status>()? {
            let status = noted.first().ok_or_else(no_status)?;
            let lag = (expected as u32).wrapping_sub(status.steps);
            if status.failed == 0 {
                self.adapt_iterations(status.iterations, lag <= self.untracked_steps);
            }
            self.untracked_steps = lag;
            if expected >= self.settled_from {
                self.settled_from = 0;
            }
        }
        let most = self.scheme.max_iterations();
        Ok(most.min(match (self.adapted, self.settled_from) {
            (true, 0) => self.iterations,
            (true, _) => (2 * self.iterations).max(MIN_ITERATIONS_AFTER_CHANGE),
            (false, _) => DEFAULT_ITERATIONS,
        }))
    }
}

impl<S: Integrator> Solver for Stepper<S> {
    fn kind(&self) -> SolverKind {
        S::KIND
    }

    fn record(
        &mut self,
        work: &mut Recorder,
        body: &mut GpuBody,
        steps: u32,
        dt: f64,
    ) -> Result<()> {
        if !self.errands.is_empty() {
            self.finish(body)?;
        }
        let iterations = self.recorded_iterations(body, steps)?;
        self.record_steps(work, body, steps, dt, iterations)?;
        if iterations > 0 {
            let expected = self.clock.recorded();
            self.ring.record(work, &self.core.status, expected)?;
        }
        Ok(())
    }

    fn advance(&mut self, body: &mut GpuBody, steps: u32, dt: f64) -> Result<()> {
        Self::check_step(body, dt)?;
        if self.status_stale && self.ring.in_flight() == 0 {
            // Steps recorded by the caller: their progress is not known yet.
            self.read_status()?;
        }
        let from = self.errands.back().map_or(self.clock.steps(), |e| e.0);
        if steps > 0 {
            self.errands.push_back((from + u64::from(steps), dt));
        }
        self.submit_pending(body)
            .inspect_err(|_| self.errands.clear())
    }

    fn progress(&mut self, body: &mut GpuBody) -> Result<Option<StepProgress>> {
        self.collect_status(body, false)?;
        self.submit_pending(body)
            .inspect_err(|_| self.errands.clear())?;
        Ok(self.last)
    }

    fn finish(&mut self, body: &mut GpuBody) -> Result<StepProgress> {
        while !self.errands.is_empty() {
            self.submit_pending(body)
                .inspect_err(|_| self.errands.clear())?;
            self.collect_status(body, true)?;
        }
        match self.last {
            Some(progress) if !self.status_stale => Ok(progress),
            _ => self.poll(body),
        }
    }

    fn poll(&mut self, body: &GpuBody) -> Result<StepProgress> {
        let status = self.read_status()?;
        match status.error(S::KIND, &self.clock, body) {
            None => Ok(status.progress(&self.clock, &body.units)),
            Some(error) => {
                self.clock.rebase();
                Err(error)
            }
        }
    }

    fn state(&self) -> Result<SolverState> {
        self.read_state()
    }

    fn set_state(&mut self, body: &GpuBody, state: &SolverState) -> Result<()> {
        self.write_state(body, state)
    }

    fn history(&self, body: &GpuBody) -> Result<Vec<StepRecord>> {
        let status: Vec<Status> = self.core.gpu.read_buffer(&self.core.status)?;
        let noted: Vec<[f32; 4]> = self.core.gpu.read_buffer(&self.core.history)?;
        let steps = status.first().map_or(0, |s| s.steps);
        Ok((steps.saturating_sub(HISTORY)..steps)
            .map(|s| StepRecord::of_gpu(noted[(s % HISTORY) as usize], &body.units))
            .collect())
    }
}
