//! Files that are read and written: the system's, or in a browser, which has none, those that were
//! put ready under a name.

use crate::{Error, Result};
use std::path::Path;

#[cfg(target_arch = "wasm32")]
pub use held::{insert_file, take_file};

/// What files are written through: the system's, or bytes in memory.
#[cfg(not(target_arch = "wasm32"))]
pub type OutFile = std::fs::File;
/// What files are written through: the system's, or bytes in memory.
#[cfg(target_arch = "wasm32")]
pub type OutFile = std::io::Cursor<Vec<u8>>;

/// The bytes of a file.
///
/// # Errors
/// [`Error::Io`] where it cannot be read.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(Error::io(path))
}

/// As [`read`], of a regular file alone: no pipe, no device.
///
/// # Errors
/// As [`read`]; [`Error::Format`] for what is no regular file.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn read_regular(path: &Path) -> Result<Vec<u8>> {
    let about = std::fs::metadata(path).map_err(Error::io(path))?;
    if about.is_dir() {
        return Err(Error::format(path, "this is a folder; name a file in it"));
    }
    if !about.is_file() {
        return Err(Error::format(path, "this is not a regular file"));
    }
    read(path)
}

/// The bytes of a file.
///
/// # Errors
/// [`Error::Io`] for one that was not put ready.
#[cfg(target_arch = "wasm32")]
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    held::get(path)
        .ok_or_else(|| Error::io(path)(std::io::Error::from(std::io::ErrorKind::NotFound)))
}

/// Whether there is something of this name to be read.
pub fn exists(path: impl AsRef<Path>) -> bool {
    #[cfg(not(target_arch = "wasm32"))]
    return path.as_ref().exists();
    #[cfg(target_arch = "wasm32")]
    return held::get(path.as_ref()).is_some();
}

/// The text of a file.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, or is not UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> Result<String> {
    let path = path.as_ref();
    let text = String::from_utf8(read(path)?);
    text.map_err(|e| Error::io(path)(std::io::Error::new(std::io::ErrorKind::InvalidData, e)))
}

#[cfg(target_arch = "wasm32")]
pub(crate) use read as read_regular;

#[cfg(target_arch = "wasm32")]
mod held {
    use std::collections::BTreeMap;
    use std::path::{Path, PathBuf};
    use std::sync::{Mutex, MutexGuard, PoisonError};

    static FILES: Mutex<BTreeMap<PathBuf, Vec<u8>>> = Mutex::new(BTreeMap::new());

    fn files() -> MutexGuard<'static, BTreeMap<PathBuf, Vec<u8>>> {
        FILES.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has `bytes` be what is read under the name `path`, in a browser; what is written there later
    /// takes its place.
    pub fn insert_file(path: impl Into<PathBuf>, bytes: Vec<u8>) {
        files().insert(path.into(), bytes);
    }

    /// The bytes under the name `path`, which are not there any more, in a browser.
    pub fn take_file(path: impl AsRef<Path>) -> Option<Vec<u8>> {
        files().remove(path.as_ref())
    }

    pub(super) fn get(path: &Path) -> Option<Vec<u8>> {
        files().get(path).cloned()
    }
}
