//! File access: the file system, or, in a browser, files registered in memory under a name.

use crate::{Error, Result};
use std::path::Path;

#[cfg(target_arch = "wasm32")]
pub use held::{insert_file, take_file};

/// The writer behind an output file: a file of the system, or bytes in memory.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) type OutFile = std::fs::File;
/// The writer behind an output file: a file of the system, or bytes in memory.
#[cfg(target_arch = "wasm32")]
pub(crate) type OutFile = std::io::Cursor<Vec<u8>>;

/// Returns the bytes of a file.
///
/// # Errors
/// An [`Error::Io`] if it cannot be read.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(Error::io(path))
}

/// As [`read`], for a regular file only: no pipe, no device.
///
/// # Errors
/// As [`read`]; an [`Error::Format`] if it is not a regular file.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn read_regular(path: &Path) -> Result<Vec<u8>> {
    let about = std::fs::metadata(path).map_err(Error::io(path))?;
    if about.is_dir() {
        return Err(Error::format(
            path,
            "expected a file, found a folder; name a file in it",
        ));
    }
    if !about.is_file() {
        return Err(Error::format(
            path,
            "expected a regular file, found a device, pipe or other \
            special file",
        ));
    }
    read(path)
}

/// Returns the bytes of a file.
///
/// # Errors
/// An [`Error::Io`] if it has not been registered with `insert_file`.
#[cfg(target_arch = "wasm32")]
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    held::get(path)
        .ok_or_else(|| Error::io(path)(std::io::Error::from(std::io::ErrorKind::NotFound)))
}

/// Whether a file of this name can be read.
pub fn exists(path: impl AsRef<Path>) -> bool {
    #[cfg(not(target_arch = "wasm32"))]
    return path.as_ref().exists();
    #[cfg(target_arch = "wasm32")]
    return held::get(path.as_ref()).is_some();
}

/// Returns the text of a file.
///
/// # Errors
/// An [`Error::Io`] if it cannot be read or is not UTF-8.
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

    /// Registers `bytes` under the name `path`, in a browser. Later writes to that name replace
    /// them.
    pub fn insert_file(path: impl Into<PathBuf>, bytes: Vec<u8>) {
        files().insert(path.into(), bytes);
    }

    /// Removes the file `path` and returns its bytes, in a browser.
    pub fn take_file(path: impl AsRef<Path>) -> Option<Vec<u8>> {
        files().remove(path.as_ref())
    }

    pub(super) fn get(path: &Path) -> Option<Vec<u8>> {
        files().get(path).cloned()
    }
}
