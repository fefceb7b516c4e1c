//! What graphics drivers and their layers print while an adapter is looked for: Mesa's layer that
//! chooses devices asks Wayland, and libwayland complains on standard error where there is no desktop.

use super::print_notes;
use palpate::Result;
use palpate::gpu::Gpu;

/// As [`Gpu::with_adapter`]; what drivers print is only told where none can be used.
///
/// # Errors
/// As [`Gpu::with_adapter`].
pub fn gpu(adapter: Option<&str>) -> Result<Gpu> {
    heard(adapter, || Gpu::with_adapter(adapter))
}

/// Does `work`, which loads drivers and takes `adapter`. What they print is told, as theirs, if it
/// fails and no adapter was named: where one was, the name is what is wrong.
///
/// # Errors
/// As `work`.
pub fn heard<T>(adapter: Option<&str>, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let (done, printed) = aside(work);
    if done.is_err() && adapter.is_none() {
        let lines = printed.lines().filter(|line| !line.trim().is_empty());
        let lines: Vec<String> = lines
            .map(|line| format!("the graphics driver says: {line}"))
            .collect();
        print_notes(&lines);
    }
    done
}

/// Does `work`, and returns what was printed on standard error meanwhile, which does not go there.
#[cfg(unix)]
fn aside<T>(work: impl FnOnce() -> T) -> (T, String) {
    // Without it what drivers print is in the way, and nothing worse.
    let Ok(mut aside) = Aside::begin() else {
        return (work(), String::new());
    };
    let done = work();
    let printed = aside.printed();
    (done, printed)
}

/// Elsewhere drivers print nothing there.
#[cfg(not(unix))]
fn aside<T>(work: impl FnOnce() -> T) -> (T, String) {
    (work(), String::new())
}

/// Standard error while it goes to a file, until this is dropped.
#[cfg(unix)]
struct Aside {
    own: std::os::fd::OwnedFd,
    file: std::fs::File,
}

#[cfg(unix)]
impl Aside {
    fn begin() -> std::io::Result<Aside> {
        use std::os::fd::AsFd;
        let own = std::io::stderr().as_fd().try_clone_to_owned()?;
        let nowhere = || std::fs::OpenOptions::new().write(true).open("/dev/null");
        let file = tempfile::tempfile().or_else(|_| nowhere())?;
        rustix::stdio::dup2_stderr(&file)?;
        Ok(Aside { own, file })
    }

    /// All that was printed so far.
    fn printed(&mut self) -> String {
        use std::io::{Read, Seek};
        let mut bytes = Vec::new();
        // What cannot be read cannot be told.
        let _ = self.file.rewind();
        let _ = self.file.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

#[cfg(unix)]
impl Drop for Aside {
    fn drop(&mut self) {
        // There is nowhere to tell it if this fails.
        let _ = rustix::stdio::dup2_stderr(&self.own);
        if std::thread::panicking() {
            use std::io::Write;
            // The message of the panic is in there.
            let _ = std::io::stderr().write_all(self.printed().as_bytes());
        }
    }
}
