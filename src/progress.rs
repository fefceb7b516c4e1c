//! Long work tells how far it is, and may be told to end.

use crate::{Error, Result};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Told what is being done and the fraction of it that is done, now and then, from any thread. Once it
/// breaks, the work ends soon, with [`Error::Cancelled`].
pub type Progress<'a> = &'a (dyn Fn(&str, f64) -> ControlFlow<()> + Sync);

/// For who need not be told, and lets all work go on.
pub fn untold(_: &str, _: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// A part of long work.
pub(crate) struct Part<'a> {
    progress: Progress<'a>,
    what: &'static str,
    share: f64,
    /// Whether it was told to end: who says so once need not again.
    ended: AtomicBool,
}

impl<'a> Part<'a> {
    /// Begins one, when `share` of all is done.
    pub fn begin(progress: Progress<'a>, what: &'static str, share: f64) -> Result<Part<'a>> {
        let part = Part {
            progress,
            what,
            share,
            ended: AtomicBool::new(false),
        };
        part.check()?;
        Ok(part)
    }

    /// Whether the work is to go on. Where it is not, loops may leave out what is left of them, for
    /// who then has [`Part::check`] end all.
    pub fn goes_on(&self) -> bool {
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
    pub fn check(&self) -> Result<()> {
        match self.goes_on() {
            true => Ok(()),
            false => Err(Error::Cancelled),
        }
    }
}
