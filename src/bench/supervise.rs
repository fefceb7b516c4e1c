//! Processes that measure parts: a crash, a lost device or a case that does not end costs a row.

use super::{Message, Outcome, Part, Row};
use crate::{Error, Result};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval at which a process is checked.
const POLL: Duration = Duration::from_millis(100);
/// Processes in a row that end in their first case before the rest of a part is given up.
const MAX_FAILURES: usize = 3;
/// Lines of a process's standard error that are kept, for the reason of a failure.
const KEPT_LINES: usize = 3;

/// How parts are measured in processes of their own.
pub struct Supervision<'a> {
    /// Returns the command that measures these cases of a part, and prints one JSON message a line.
    pub command: &'a dyn Fn(&Part, Range<usize>) -> Command,
    /// Fewer and smaller cases.
    pub quick: bool,
    /// Longest time of one case.
    pub limit: Duration,
    /// Receives the next case and its number.
    pub progress: &'a dyn Fn(&Part, &Row, usize),
    /// Set from outside to stop early.
    pub stop: &'a AtomicBool,
}

/// Measures the parts in order and hands over the rows of each case.
///
/// # Errors
/// As `keep`; [`Error::Io`] if a process cannot be started.
pub fn measure_all(
    how: &Supervision,
    parts: &[&Part],
    keep: &mut dyn FnMut(Vec<Row>) -> Result<()>,
) -> Result<()> {
    let mut before = 0;
    for part in parts {
        before += measure_part(how, part, before, keep)?;
    }
    Ok(())
}

/// Measures a part; returns the number of its cases.
fn measure_part(
    how: &Supervision,
    part: &Part,
    before: usize,
    keep: &mut dyn FnMut(Vec<Row>) -> Result<()>,
) -> Result<usize> {
    let cases = (part.cases)(how.quick);
    let rows: Vec<Row> = cases.into_iter().map(|case| case.row).collect();
    let (mut next, mut failures) = (0, 0);
    while next < rows.len() && !how.stop.load(Ordering::Relaxed) {
        let end = if part.separate { next + 1 } else { rows.len() };
        let first = next;
        let progress = |case: usize| {
            if let Some(row) = rows.get(case).filter(|_| case < end) {
                (how.progress)(part, row, before + case);
            }
        };
        let reason = measure_in_process(how, part, first..end, &mut next, &progress, keep)?;
        let Some(reason) = reason else { continue };
        failures = if next == first { failures + 1 } else { 1 };
        // One row, or what is left of a part whose processes do not start.
        let last = if failures < MAX_FAILURES {
            next + 1
        } else {
            rows.len()
        };
        let failed = rows[next..last].iter().map(|row| Row {
            part: part.name.into(),
            ..row.clone().ended(Outcome::Failed, reason.clone())
        });
        keep(failed.collect())?;
        next = last;
    }
    Ok(rows.len())
}

/// Measures cases in one process, and advances `next` past those measured. Returns the reason if
/// the process ended without the next one.
fn measure_in_process(
    how: &Supervision,
    part: &Part,
    cases: Range<usize>,
    next: &mut usize,
    progress: &dyn Fn(usize),
    keep: &mut dyn FnMut(Vec<Row>) -> Result<()>,
) -> Result<Option<String>> {
    progress(*next);
    let mut process = Process::start((how.command)(part, cases.clone()))?;
    let (mut began, mut too_long, mut lost) = (Instant::now(), false, false);
    loop {
        match process.lines.recv_timeout(POLL) {
            // Drivers may print other lines.
            Ok(line) => {
                let Ok(message) = serde_json::from_str::<Message>(&line) else {
                    continue;
                };
                if message.case != *next {
                    continue;
                }
                *next += 1;
                lost = message.lost;
                keep(message.rows)?;
                progress(*next);
                began = Instant::now();
            }
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {
                too_long = began.elapsed() > how.limit;
                if too_long || how.stop.load(Ordering::Relaxed) {
                    process.kill();
                    break;
                }
            }
        }
    }
    let (status, output) = process.end()?;
    if *next >= cases.end || lost || how.stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let mut reason = match too_long {
        true => format!("did not end within {} s", how.limit.as_secs()),
        false => format!("the process ended ({status})"),
    };
    if !output.is_empty() {
        reason += &format!(": {output}");
    }
    Ok(Some(reason))
}

/// A process whose output is read by threads.
struct Process {
    child: Child,
    lines: Receiver<String>,
    errors: JoinHandle<String>,
}

impl Process {
    fn start(mut command: Command) -> Result<Process> {
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        // Ctrl-C reaches only this process, which then ends the other.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let program = command.get_program().to_owned();
        let mut child = command.spawn().map_err(Error::io(program))?;
        let (sender, lines) = channel();
        let (out, err) = (child.stdout.take(), child.stderr.take());
        std::thread::spawn(move || {
            for line in out.into_iter().flat_map(|out| BufReader::new(out).lines()) {
                // The receiver is gone once the process is to end.
                let Ok(()) = line.map_or(Ok(()), |line| sender.send(line)) else {
                    break;
                };
            }
        });
        let errors = std::thread::spawn(move || err.map(last_lines).unwrap_or_default());
        Ok(Process {
            child,
            lines,
            errors,
        })
    }

    fn kill(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
    }

    /// Waits for the end; returns the status and the last lines of standard error.
    fn end(mut self) -> Result<(ExitStatus, String)> {
        let status = self.child.wait().map_err(Error::io("process of a part"))?;
        Ok((status, self.errors.join().unwrap_or_default()))
    }
}

/// Returns the last lines of what a process prints, joined.
fn last_lines(source: impl Read) -> String {
    let mut kept = VecDeque::new();
    for line in BufReader::new(source).split(b'\n').map_while(|l| l.ok()) {
        let line = String::from_utf8_lossy(&line).trim().to_owned();
        if !line.is_empty() {
            kept.push_back(line);
        }
        if kept.len() > KEPT_LINES {
            kept.pop_front();
        }
    }
    Vec::from(kept).join(" / ")
}
