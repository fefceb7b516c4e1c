//! Progress reports: a bar on a terminal, a line every few seconds elsewhere, nothing with
//! `--quiet`.

use indicatif::{ProgressBar, ProgressStyle};
use palpate::scene::Stage;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval of the lines if standard error is not a terminal.
const INTERVAL: Duration = Duration::from_secs(5);
/// Steps of the bar of a stage.
const BAR_STEPS: u64 = 1000;

/// The progress of the current work.
pub struct ProgressReporter {
    bar: ProgressBar,
    lines: Option<Lines>,
}

impl ProgressReporter {
    /// Creates a reporter that stays silent until the work takes longer than an interval.
    fn new(bar: ProgressBar, state: State) -> ProgressReporter {
        if super::is_quiet() {
            return ProgressReporter {
                bar: ProgressBar::hidden(),
                lines: None,
            };
        }
        let has_bar = std::io::stderr().is_terminal();
        ProgressReporter {
            bar,
            lines: (!has_bar).then(|| Lines::start(state, INTERVAL, to_stderr)),
        }
    }

    /// Sets the number of completed items.
    pub fn set_position(&self, done: u64) {
        self.bar.set_position(done);
        self.change(|state| state.done = done);
    }

    /// Increments the number of completed items.
    pub fn inc(&self, more: u64) {
        self.bar.inc(more);
        self.change(|state| state.done += more);
    }

    /// Sets the description of the current item.
    pub fn detail(&self, detail: String) {
        self.change(|state| state.detail = detail);
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        if let Some(lines) = &self.lines {
            change(&mut lock(&lines.shared.0));
        }
    }
}

/// Shows a bar over `total` items named `what` during `work`.
pub fn with_bar<T>(what: &'static str, total: u64, work: impl FnOnce(&ProgressReporter) -> T) -> T {
    let bar = ProgressBar::new(total);
    let template = "{msg} {wide_bar} {pos}/{len} [{elapsed} < {eta}]";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(what);
    let progress = ProgressReporter::new(bar, State::new(what, total));
    let result = work(&progress);
    progress.bar.finish_and_clear();
    result
}

/// Shows the current stage and its fraction during `work`.
pub fn with_stages<T>(work: impl FnOnce(palpate::ProgressFn) -> T) -> T {
    let bar = ProgressBar::new(BAR_STEPS);
    if let Ok(style) = ProgressStyle::with_template("{msg:12} {wide_bar} [{elapsed}]") {
        bar.set_style(style);
    }
    // Until the work names its first stage.
    bar.set_message("preparing");
    let progress = ProgressReporter::new(bar, State::new("preparing", 0));
    let result = work(&|what, done| {
        progress.bar.set_message(what.to_owned());
        progress.bar.set_position((done * BAR_STEPS as f64) as u64);
        progress.change(|state| {
            state.what = what.to_owned();
            state.share = Some(done);
        });
        ControlFlow::Continue(())
    });
    progress.bar.finish_and_clear();
    result
}

/// Reports `what` as the current work, if it takes long.
pub fn with_message<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let bar = ProgressBar::hidden();
    let progress = ProgressReporter::new(bar, State::new(what, 0));
    let result = work();
    drop(progress);
    result
}

/// Runs `steps` steps of `stage`, with a bar and the iterations of the last step.
///
/// # Errors
/// As [`Stage::run`].
pub fn run(
    stage: &mut Stage,
    steps: u32,
    report: &mut dyn FnMut(u32, Option<u32>),
) -> palpate::Result<()> {
    let iterates = |stage: &Stage| {
        let progress = stage.motion().and_then(|m| m.progress());
        progress.map(|p| p.last.iterations).filter(|n| *n > 0)
    };
    let implicit = stage.motion().is_some_and(|m| m.kind().is_implicit());
    if !implicit {
        return stage.run(steps, &mut |done| report(done, None));
    }
    for done in 1..=steps {
        stage.run(1, &mut |_| {})?;
        report(done, iterates(stage));
    }
    Ok(())
}

/// Formats the number of iterations of the last step.
pub fn iterations(count: Option<u32>) -> String {
    count.map_or(String::new(), |n| {
        format!("{n} iterations in the last step")
    })
}

/// Data of a line.
#[derive(Clone, Debug)]
struct State {
    what: String,
    detail: String,
    done: u64,
    /// Total number of items; 0 if unknown.
    total: u64,
    /// The completed fraction, if items are not counted.
    share: Option<f64>,
    start: Instant,
    ended: bool,
}

impl State {
    fn new(what: &str, total: u64) -> State {
        State {
            what: what.to_owned(),
            detail: String::new(),
            done: 0,
            total,
            share: None,
            start: Instant::now(),
            ended: false,
        }
    }

    /// Formats the line.
    fn line(&self) -> String {
        let elapsed = self.start.elapsed().as_secs_f64();
        let mut line = match (self.total, self.share) {
            (0, None) => self.what.clone(),
            (0, Some(share)) => format!("{}: {:.0} %", self.what, 100.0 * share),
            (total, _) => format!("{} {} of {total}", self.what, self.done),
        };
        if !self.detail.is_empty() {
            line += &format!(", {}", self.detail);
        }
        line += &format!(", {} elapsed", duration(elapsed));
        if self.total > 0 && self.done > 0 {
            let left = elapsed * self.total.saturating_sub(self.done) as f64 / self.done as f64;
            line += &format!(", about {} remaining", duration(left));
        }
        line
    }
}

/// A thread that prints the progress at intervals until it is dropped.
struct Lines {
    shared: Arc<(Mutex<State>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Lines {
    fn start(
        state: State,
        interval: Duration,
        mut say: impl FnMut(&str) + Send + 'static,
    ) -> Lines {
        let shared = Arc::new((Mutex::new(state), Condvar::new()));
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("progress".into())
            .spawn(move || {
                let mut state = lock(&theirs.0);
                let mut due = Instant::now() + interval;
                while !state.ended {
                    let wait = due.saturating_duration_since(Instant::now());
                    if wait.is_zero() {
                        let line = state.line();
                        drop(state);
                        say(&line);
                        due = Instant::now() + interval;
                        state = lock(&theirs.0);
                        continue;
                    }
                    state = match theirs.1.wait_timeout(state, wait) {
                        Ok((state, _)) => state,
                        Err(poisoned) => poisoned.into_inner().0,
                    };
                }
            });
        Lines {
            shared,
            // Without a thread no lines are printed, and the work continues.
            thread: thread.ok(),
        }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        lock(&self.shared.0).ended = true;
        self.shared.1.notify_all();
        if let Some(thread) = self.thread.take() {
            // A failure to print a line is ignored.
            let _ = thread.join();
        }
    }
}

/// Locks the state, also after a panic elsewhere.
fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn to_stderr(line: &str) {
    // If standard error is closed, the line cannot be printed.
    let _ = writeln!(std::io::stderr(), "palpate: {line}");
}

/// Formats a duration: `8 s`, `3 min 5 s`, `2 h 10 min`.
fn duration(seconds: f64) -> String {
    let seconds = seconds.max(0.0).round() as u64;
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        _ => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn progress_lines_report_step_time_and_iterations() {
        let lines_printed = Arc::new(Mutex::new(Vec::new()));
        let ours = Arc::clone(&lines_printed);
        let mut state = State::new("steps", 50);
        state.start -= Duration::from_secs(65);
        let lines = Lines::start(state, Duration::from_millis(20), move |line| {
            ours.lock().unwrap().push(line.to_owned());
        });
        {
            let mut state = lock(&lines.shared.0);
            state.done = 25;
            state.detail = iterations(Some(311));
        }
        while lines_printed.lock().unwrap().len() < 3 {
            std::thread::sleep(Duration::from_millis(5));
        }
        drop(lines);
        let printed = lines_printed.lock().unwrap().clone();
        let last = printed.last().unwrap();
        let start = "steps 25 of 50, 311 iterations in the last step, 1 min";
        assert!(
            last.starts_with(start) && last.ends_with(" remaining"),
            "{last}"
        );
        std::thread::sleep(Duration::from_millis(60));
        assert_eq!(lines_printed.lock().unwrap().len(), printed.len());
    }

    #[test]
    fn short_work_prints_no_progress() {
        let lines_printed = Arc::new(Mutex::new(0));
        let ours = Arc::clone(&lines_printed);
        let state = State::new("steps", 5);
        drop(Lines::start(state, Duration::from_secs(60), move |_| {
            *ours.lock().unwrap() += 1;
        }));
        assert_eq!(*lines_printed.lock().unwrap(), 0);
    }

    #[test]
    fn progress_lines_report_stage_and_fraction() {
        let mut state = State::new("lattice", 0);
        state.share = Some(0.25);
        assert_eq!(state.line(), "lattice: 25 %, 0 s elapsed");
        assert_eq!(duration(3700.0), "1 h 1 min");
    }
}
