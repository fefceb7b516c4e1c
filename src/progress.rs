//! Progress reports and cancellation of long work.

use crate::{Error, Result};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Callback that receives the name of the current stage and the completed fraction in 0..1, at
/// intervals, from any thread. If it returns `Break`, the work ends soon with [`Error::Cancelled`].
pub type ProgressFn<'a> = &'a (dyn Fn(&str, f64) -> ControlFlow<()> + Sync);

/// A callback that ignores progress and never cancels.
pub fn no_progress(_: &str, _: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// A stage of long work.
pub(crate) struct ProgressScope<'a> {
    progress: ProgressFn<'a>,
    what: &'static str,
    share: f64,
    /// Whether the callback has cancelled the work; it is not called again after that.
    ended: AtomicBool,
}

impl<'a> ProgressScope<'a> {
    /// Begins a stage when the fraction `share` of the whole work is done.
    pub fn begin(
        progress: ProgressFn<'a>,
        what: &'static str,
        share: f64,
    ) -> Result<ProgressScope<'a>> {
        let part = ProgressScope {
            progress,
            what,
            share,
            ended: AtomicBool::new(false),
        };
        part.check_cancelled()?;
        Ok(part)
    }

    /// Whether the work should continue. If not, loops may skip the rest, since the caller then
    /// calls [`ProgressScope::check_cancelled`], which ends the work.
    pub fn should_continue(&self) -> bool {
        if self.ended.load(Ordering::Relaxed) {
            return false;
        }
        let continues = (self.progress)(self.what, self.share).is_continue();
        if !continues {
            self.ended.store(true, Ordering::Relaxed);
        }
        continues
    }

    /// Returns an error if the work has been cancelled.
    pub fn check_cancelled(&self) -> Result<()> {
        match self.should_continue() {
            true => Ok(()),
            false => Err(Error::Cancelled),
        }
    }
}
