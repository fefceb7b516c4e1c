//! Long work tells how far it is, and may be told to end.

use crate::{Error, Result};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Told what is being done and the fraction of it that is done, now and then, from any thread. Once it
/// breaks, the work ends soon, with [`Error::Cancelled`].
pub type ProgressFn<'a> = &'a (dyn Fn(&str, f64) -> ControlFlow<()> + Sync);

/// For who need not be told, and lets all work go on.
pub fn no_progress(_: &str, _: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// A part of long work.
pub(crate) struct ProgressScope<'a> {
    progress: ProgressFn<'a>,
    what: &'static str,
    share: f64,
    /// Whether it was told to end: who says so once need not again.
    ended: AtomicBool,
}

impl<'a> ProgressScope<'a> {
    /// Begins one, when `share` of all is done.
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

    /// Whether the work is to go on. Where it is not, loops may leave out what is left of them, for
    /// who then has [`ProgressScope::check_cancelled`] end all.
    pub fn should_continue(&self) -> bool {
        if self.ended.load(Ordering::Relaxed) {
            return false;
        }
        let goes_on = (self.progress)(self.what, self.share).is_continue();
        if !goes_on {
            self.ended.store(true, Ordering::Relaxed);
        }
        goes_on
    }

    /// Ends work that is not to go on.
    pub fn check_cancelled(&self) -> Result<()> {
        match self.should_continue() {
            true => Ok(()),
            false => Err(Error::Cancelled),
        }
    }
}
