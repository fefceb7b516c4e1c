//! A body on its own worker thread. Steps are requested and run asynchronously; the caller polls
//! the progress and reads the latest published positions.

use super::energy_guard::StepFailure;
use super::steppable::{LoadUpdate, Steppable};
use crate::physics::{StepCallback, StepProgress, StepRecord};
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use web_time::{Duration, Instant};

/// Interval at which positions are published during steps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(15);

/// Number of steps whose iteration counts are kept.
const HISTORY: usize = 1024;

/// A command for the worker, run in order.
#[derive(Debug)]
pub(in crate::physics) enum WorkerCommand {
    /// Take this many steps of this many seconds.
    Steps(u32, f64),
    /// Apply loads.
    Loads(Box<LoadUpdate>),
}

/// Pending commands and the progress of the steps.
#[derive(Debug, Default)]
struct Queue {
    commands: VecDeque<WorkerCommand>,
    busy: bool,
    quit: bool,
    /// Whether the rest of the current steps is to be dropped.
    cancelling: bool,
    progress: StepProgress,
    /// Steps of the current length, and the time before them.
    span: StepClock,
    iterations: VecDeque<u32>,
    /// Why the last step was rejected, its length, and the progress at that point.
    failure: Option<(StepFailure, f64, StepProgress)>,
    refused: Option<Error>,
}

/// Number of steps of one length since a time. The time is not summed step by step, so its rounding
/// does not depend on how the steps were batched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::physics) struct StepClock {
    since: f64,
    steps: u64,
    dt: f64,
}

impl StepClock {
    fn add(&mut self, steps: u32, dt: f64) {
        if self.dt != dt {
            *self = StepClock {
                since: self.time(),
                steps: 0,
                dt,
            };
        }
        self.steps += u64::from(steps);
    }

    fn time(&self) -> f64 {
        self.since + self.steps as f64 * self.dt
    }
}

/// Latest published positions, in metres.
#[derive(Debug, Default)]
struct PositionSnapshot {
    version: u64,
    positions: Vec<DVec3>,
}

struct Shared<B: Steppable + ?Sized> {
    body: Mutex<Box<B>>,
    queue: Mutex<Queue>,
    /// Signals that there is work, or that the thread is to quit.
    wake: Condvar,
    idle_signal: Condvar,
    published: Mutex<PositionSnapshot>,
    waker: Mutex<Option<StepCallback>>,
}

/// A body and its worker thread.
pub(in crate::physics) struct Worker<B: Steppable + ?Sized> {
    shared: Arc<Shared<B>>,
    thread: Option<JoinHandle<()>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<B: Steppable + ?Sized> Worker<B> {
    pub fn new(body: Box<B>) -> Worker<B> {
        Worker {
            shared: Arc::new(Shared {
                body: Mutex::new(body),
                queue: Mutex::default(),
                wake: Condvar::new(),
                idle_signal: Condvar::new(),
                published: Mutex::default(),
                waker: Mutex::default(),
            }),
            thread: None,
        }
    }

    /// Locks the body between two steps, ahead of the pending commands.
    pub fn body(&self) -> MutexGuard<'_, Box<B>> {
        lock(&self.shared.body)
    }

    /// Returns the positions, m, without waiting for a step in progress if any were published.
    pub fn positions(&self) -> Vec<DVec3> {
        if let Ok(body) = self.shared.body.try_lock() {
            return body.positions();
        }
        let published = lock(&self.shared.published).positions.clone();
        match published.is_empty() {
            true => self.body().positions(),
            false => published,
        }
    }

    /// Queues a command.
    ///
    /// # Errors
    /// [`Error::Input`] if no thread can be started.
    pub fn enqueue(&mut self, errand: WorkerCommand) -> Result<()> {
        if cfg!(target_arch = "wasm32") {
            // Without threads the command runs at once.
            lock(&self.shared.queue).commands.push_back(errand);
            while self.shared.process_next() {}
            self.publish();
            return Ok(());
        }
        if self.thread.is_none() {
            let shared = self.shared.clone();
            let thread = std::thread::Builder::new().name("palpate-body".into());
            let thread = thread.spawn(move || shared.work());
            self.thread =
                Some(thread.map_err(|e| {
                    Error::Input(format!("cannot start the simulation thread: {e}"))
                })?);
        }
        lock(&self.shared.queue).commands.push_back(errand);
        self.shared.wake.notify_one();
        Ok(())
    }

    /// Returns the progress, or the failure of a step and its length; a failure is reported once.
    pub fn progress(&self) -> std::result::Result<StepProgress, WorkerError> {
        let mut queue = lock(&self.shared.queue);
        take_result(&mut queue)
    }

    /// As [`Worker::progress`], after waiting for all queued commands.
    pub fn finish(&self) -> std::result::Result<StepProgress, WorkerError> {
        let mut queue = lock(&self.shared.queue);
        while queue.busy || !queue.commands.is_empty() {
            let waited = self.shared.idle_signal.wait(queue);
            queue = waited.unwrap_or_else(PoisonError::into_inner);
        }
        take_result(&mut queue)
    }

    /// Drops the queued commands and their results; waits for a step in progress.
    pub fn cancel_pending(&self) {
        let mut queue = lock(&self.shared.queue);
        queue.commands.clear();
        queue.cancelling = true;
        while queue.busy {
            let waited = self.shared.idle_signal.wait(queue);
            queue = waited.unwrap_or_else(PoisonError::into_inner);
        }
        queue.cancelling = false;
        (queue.failure, queue.refused) = (None, None);
    }

    /// Returns the step clock, for another worker to continue from.
    pub fn span(&self) -> StepClock {
        lock(&self.shared.queue).span
    }

    /// Sets the progress to continue from.
    pub fn set_progress(&self, progress: StepProgress, span: StepClock) {
        let mut queue = lock(&self.shared.queue);
        (queue.progress, queue.span) = (progress, span);
        queue.iterations.clear();
    }

    /// Counts steps that the body took outside the queue, and returns the progress.
    pub fn count_steps(&self, steps: u32, dt: f64, last: Option<StepRecord>) -> StepProgress {
        let mut queue = lock(&self.shared.queue);
        queue.progress.steps += u64::from(steps);
        queue.span.add(steps, dt);
        queue.progress.time = queue.span.time();
        if let Some(record) = last {
            queue.progress.last = record;
        }
        queue.progress
    }

    /// Returns the iteration counts of the latest steps, oldest first.
    pub fn iterations(&self) -> Vec<u32> {
        lock(&self.shared.queue)
            .iterations
            .iter()
            .copied()
            .collect()
    }

    /// Returns the latest published positions, m, if they are newer than version `known`.
    pub fn published(&self, known: u64) -> Option<(u64, Vec<DVec3>)> {
        let published = lock(&self.shared.published);
        (published.version != known).then(|| (published.version, published.positions.clone()))
    }

    /// Sets a callback that the body's thread calls whenever positions are published.
    pub fn set_waker(&self, waker: StepCallback) {
        *lock(&self.shared.waker) = Some(waker);
    }

    /// Publishes the current positions.
    pub fn publish(&self) {
        self.shared.publish(&**self.body());
    }
}

impl<B: Steppable + ?Sized> Drop for Worker<B> {
    fn drop(&mut self) {
        lock(&self.shared.queue).quit = true;
        self.shared.wake.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic of the worker thread must not propagate from here.
            let _ = thread.join();
        }
    }
}

/// Why a command was rejected.
pub(in crate::physics) enum WorkerError {
    /// The simulation failed, at a step of that many seconds.
    Failed(StepFailure, f64, StepProgress),
    /// The command was invalid.
    Wrong(Error),
}

fn take_result(queue: &mut Queue) -> std::result::Result<StepProgress, WorkerError> {
    if let Some(error) = queue.refused.take() {
        return Err(WorkerError::Wrong(error));
    }
    match queue.failure.take() {
        Some((failure, dt, progress)) => Err(WorkerError::Failed(failure, dt, progress)),
        None => Ok(queue.progress),
    }
}

impl<B: Steppable + ?Sized> Shared<B> {
    fn work(&self) {
        loop {
            {
                let mut queue = lock(&self.queue);
                while queue.commands.is_empty() && !queue.quit {
                    queue = self
                        .wake
                        .wait(queue)
                        .unwrap_or_else(PoisonError::into_inner);
                }
                if queue.quit {
                    return;
                }
                queue.busy = true;
            }
            let done = catch_unwind(AssertUnwindSafe(|| {
                let mut put_out = Instant::now();
                while self.process_next() {
                    if put_out.elapsed() > PUBLISH_INTERVAL {
                        self.publish(&**lock(&self.body));
                        self.notify();
                        put_out = Instant::now();
                    }
                }
                self.publish(&**lock(&self.body));
            }));
            let mut queue = lock(&self.queue);
            if done.is_err() {
                queue.commands.clear();
                let why = "internal error in the simulation thread; please report it";
                queue.refused = Some(Error::Input(why.into()));
            }
            queue.busy = false;
            drop(queue);
            self.idle_signal.notify_all();
            self.notify();
        }
    }

    /// Calls the registered callback.
    fn notify(&self) {
        let waker = lock(&self.waker).clone();
        if let Some(waker) = waker {
            waker();
        }
    }

    /// Runs one command, at most a few milliseconds of steps; returns whether there was one.
    fn process_next(&self) -> bool {
        let errand = {
            let mut queue = lock(&self.queue);
            if queue.quit {
                return false;
            }
            let failed = queue.failure.is_some();
            let mut errand = queue.commands.pop_front();
            // Steps requested before the failure was reported are dropped.
            while failed && matches!(errand, Some(WorkerCommand::Steps(..))) {
                errand = queue.commands.pop_front();
            }
            errand
        };
        match errand {
            None => return false,
            Some(WorkerCommand::Loads(change)) => {
                if let Err(error) = lock(&self.body).apply_loads(*change) {
                    self.discard_steps().refused = Some(error);
                }
            }
            Some(WorkerCommand::Steps(left, dt)) => self.steps(left, dt),
        }
        true
    }

    fn steps(&self, left: u32, dt: f64) {
        let mut body = lock(&self.body);
        // Every implicit step is reported; explicit ones are short.
        let implicit = body.has_long_steps();
        let mut some = 1;
        let (start, mut done) = (Instant::now(), 0);
        let mut record: Option<StepRecord> = None;
        let mut failure = None;
        while done < left && failure.is_none() && start.elapsed() < PUBLISH_INTERVAL / 2 {
            let before = body.steps();
            match body.run(some.min(left - done), dt) {
                Ok(last) => record = Some(last),
                Err(why) => failure = Some(why),
            }
            done += (body.steps() - before) as u32;
            if implicit {
                break;
            }
            some *= 2;
        }
        drop(body);
        let mut queue = lock(&self.queue);
        queue.progress.steps += u64::from(done);
        queue.span.add(done, dt);
        queue.progress.time = queue.span.time();
        if let Some(record) = record {
            queue.progress.last = record;
            if implicit {
                if queue.iterations.len() == HISTORY {
                    queue.iterations.pop_front();
                }
                queue.iterations.push_back(record.iterations);
            }
        }
        if let Some(why) = failure {
            let progress = queue.progress;
            drop(queue);
            self.discard_steps().failure = Some((why, dt, progress));
        } else if done < left && !queue.cancelling {
            queue
                .commands
                .push_front(WorkerCommand::Steps(left - done, dt));
        }
    }

    fn discard_steps(&self) -> MutexGuard<'_, Queue> {
        let mut queue = lock(&self.queue);
        queue
            .commands
            .retain(|e| !matches!(e, WorkerCommand::Steps(..)));
        queue
    }

    fn publish(&self, body: &B) {
        let positions = body.positions();
        let mut published = lock(&self.published);
        published.positions = positions;
        published.version += 1;
    }
}
