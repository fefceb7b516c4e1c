//! Keeps the output of graphics drivers off standard error: Mesa's device-select layer calls
//! libwayland, which complains there if there is no desktop.

use super::print_notes;
use palpate::Result;
use palpate::gpu::Gpu;

/// As [`Gpu::with_adapter`]; the driver's own output is printed only if no adapter works.
///
/// # Errors
/// As [`Gpu::with_adapter`].
pub fn gpu(adapter: Option<&str>) -> Result<Gpu> {
    with_driver_output_held(adapter, || Gpu::with_adapter(adapter))
}

/// Runs `work`, which loads the drivers. If it fails and no adapter was named, prints the output of
/// the drivers, marked as such; if one was named, the name is the likely error.
///
/// # Errors
/// As `work`.
pub fn with_driver_output_held<T>(
    adapter: Option<&str>,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let (done, output) = capture_stderr(work);
    if done.is_err() && adapter.is_none() {
        let lines = output.lines().filter(|line| !line.trim().is_empty());
        let lines: Vec<String> = lines
            .map(|line| format!("graphics driver: {line}"))
            .collect();
        print_notes(&lines);
    }
    done
}

/// Runs `work` with standard error redirected, and returns what was written to it.
#[cfg(unix)]
fn capture_stderr<T>(work: impl FnOnce() -> T) -> (T, String) {
    // Without the redirection the drivers' output is visible, which is harmless.
    let Ok(mut capture) = StderrCapture::begin() else {
        return (work(), String::new());
    };
    let done = work();
    let output = capture.output();
    (done, output)
}

/// Drivers on other systems print nothing to standard error.
#[cfg(not(unix))]
fn capture_stderr<T>(work: impl FnOnce() -> T) -> (T, String) {
    (work(), String::new())
}

/// Redirects standard error to a temporary file until dropped.
#[cfg(unix)]
struct StderrCapture {
    own: std::os::fd::OwnedFd,
    file: std::fs::File,
}

#[cfg(unix)]
impl StderrCapture {
    fn begin() -> std::io::Result<StderrCapture> {
        use std::os::fd::AsFd;
        let own = std::io::stderr().as_fd().try_clone_to_owned()?;
        let nowhere = || std::fs::OpenOptions::new().write(true).open("/dev/null");
        let file = tempfile::tempfile().or_else(|_| nowhere())?;
        rustix::stdio::dup2_stderr(&file)?;
        Ok(StderrCapture { own, file })
    }

    /// Returns everything written so far.
    fn output(&mut self) -> String {
        use std::io::{Read, Seek};
        let mut bytes = Vec::new();
        // An unreadable file gives an empty text.
        let _ = self.file.rewind();
        let _ = self.file.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

#[cfg(unix)]
impl Drop for StderrCapture {
    fn drop(&mut self) {
        // A failure cannot be reported anywhere.
        let _ = rustix::stdio::dup2_stderr(&self.own);
        if std::thread::panicking() {
            use std::io::Write;
            // The file holds the panic's message.
            let _ = std::io::stderr().write_all(self.output().as_bytes());
        }
    }
}
