//! The error type of the library. A message states what happened, where, and the remedy.

use std::path::{Path, PathBuf};

/// Shorthand for a result with Palpate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// The errors of the library.
///
/// Each message states what happened, where, and the remedy. A panic is a bug.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to open, read or write a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },

    /// A file does not conform to its format (or the format is unknown).
    #[error("{}: {what}", path.display())]
    Format {
        /// The file concerned.
        path: PathBuf,
        /// The defect, its position in the file (line, byte or section), and the expected content.
        what: String,
    },

    /// An invalid mesh: no tetrahedra, indices out of range, NaN coordinates.
    #[error("mesh: {0}")]
    Mesh(String),

    /// An invalid argument, option or scene entry; the message states the valid values.
    #[error("{0}")]
    Input(String),

    /// No graphics adapter could be used.
    #[error("no usable graphics adapter: {0}")]
    NoAdapter(String),

    /// The graphics device rejected the work: a limit, an allocation, a shader.
    #[error("GPU: {0}")]
    Gpu(String),

    /// The graphics device was lost (driver reset, unplugged, timed out).
    #[error(
        "graphics device lost, with all its data ({0}); create a new `Gpu`, and if the driver \
        timed out, submit less work at a time"
    )]
    DeviceLost(String),

    /// The progress callback cancelled the work.
    #[error("cancelled")]
    Cancelled,

    /// A simulation failed and was frozen in its last valid state.
    #[error("{solver} failed at step {step} (t = {time:.6} s): {what}; {advice}")]
    Solver {
        /// The solver's name, as on the command line.
        solver: &'static str,
        /// The step at which it failed, counted from 1.
        step: u64,
        /// The simulated time of the last valid state, in seconds.
        time: f64,
        /// The detected cause.
        cause: FailureCause,
        /// The cause in words, with numbers.
        what: String,
        /// The advised change.
        advice: String,
    },
}

/// Cause of the failure of a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FailureCause {
    /// A position, velocity or force is no longer a finite number.
    NotFinite,
    /// The energy of the body is far above the energy supplied.
    RunawayEnergy,
    /// A linear solve reached its iteration limit with a large residual.
    NotConverged,
    /// A step inverted tets.
    InvertedTets,
    /// Particles are farther apart than the deformation can account for.
    FlownApart,
}

impl Error {
    /// Returns the closure that makes an [`Error::Io`] for `path`, for use with `map_err`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_path_buf();
        move |source| Error::Io { path, source }
    }

    /// Creates an [`Error::Format`] for `path`.
    pub fn format(path: impl AsRef<Path>, what: impl Into<String>) -> Error {
        Error::Format {
            path: path.as_ref().to_path_buf(),
            what: what.into(),
        }
    }
}
