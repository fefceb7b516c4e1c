//! Atomic writing of files.

use crate::files::OutFile;
use crate::{Error, Result};
#[cfg(not(target_arch = "wasm32"))]
use std::fs::File;
use std::io::BufWriter;
#[cfg(not(target_arch = "wasm32"))]
use std::io::Write;
use std::path::Path;
#[cfg(not(target_arch = "wasm32"))]
use std::path::PathBuf;

/// Writes a file under a temporary name in the same folder and renames it once `fill` has
/// succeeded: readers see either the old or the complete new file. Anything but a regular file (a
/// pipe, `/dev/null`) is written to directly.
///
/// # Errors
/// The errors of `fill`, or an error if the file cannot be created, written or renamed; the
/// temporary file is then removed and an older file of that name is unchanged.
pub fn atomic_write(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&mut BufWriter<OutFile>) -> Result<()>,
) -> Result<()> {
    let mut fill = Some(fill);
    whole_or_not(path.as_ref(), &mut |file| match fill.take() {
        Some(fill) => fill(file),
        None => Ok(()),
    })
}

/// Callback that writes the content of a file, called once.
type Fill<'a> = &'a mut dyn FnMut(&mut BufWriter<OutFile>) -> Result<()>;

#[cfg(not(target_arch = "wasm32"))]
fn whole_or_not(path: &Path, fill: Fill<'_>) -> Result<()> {
    // A symbolic link is preserved: the file that it points to is replaced.
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    if let Ok(about) = std::fs::metadata(&target)
        && !about.is_file()
        && !about.is_dir()
    {
        let mut file = BufWriter::new(File::create(&target).map_err(Error::io(path))?);
        fill(&mut file)?;
        return file.flush().map_err(Error::io(path));
    }
    if target.is_dir() {
        return Err(Error::format(path, "cannot write to a folder; name a file"));
    }
    replace(path, &target, folder_of(&target), fill)
}

/// Returns the folder of a file.
#[cfg(not(target_arch = "wasm32"))]
fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(target_arch = "wasm32")]
fn whole_or_not(path: &Path, fill: Fill<'_>) -> Result<()> {
    let mut file = BufWriter::new(OutFile::default());
    fill(&mut file)?;
    let file = file.into_inner().map_err(|e| Error::io(path)(e.into()))?;
    crate::files::insert_file(path, file.into_inner());
    Ok(())
}

/// Writes a temporary file in `folder` and renames it to `target`; errors name `path`.
#[cfg(not(target_arch = "wasm32"))]
fn replace(path: &Path, target: &Path, folder: &Path, fill: Fill<'_>) -> Result<()> {
    let (file, unfinished) = TempFile::begin(path, target, folder)?;
    let mut file = BufWriter::new(file);
    fill(&mut file)?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    unfinished.finish()
}

/// A file under a temporary name, removed on drop unless it is finished.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) struct TempFile {
    path: PathBuf,
    target: PathBuf,
    temporary: tempfile::TempPath,
}

#[cfg(not(target_arch = "wasm32"))]
impl TempFile {
    /// Creates a file to be renamed to `path`; returns it for writing.
    ///
    /// # Errors
    /// An error if it cannot be created, or if `path` exists and is not a regular file.
    pub fn create(path: &Path) -> Result<(File, TempFile)> {
        let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        if std::fs::metadata(&target).is_ok_and(|about| !about.is_file()) {
            return Err(Error::format(
                path,
                "exists and is not a regular file; choose another output file",
            ));
        }
        TempFile::begin(path, &target, folder_of(&target))
    }

    fn begin(path: &Path, target: &Path, folder: &Path) -> Result<(File, TempFile)> {
        let mut options = tempfile::Builder::new();
        options.prefix(".palpate-").suffix(".part");
        #[cfg(unix)]
        let everyone = std::os::unix::fs::PermissionsExt::from_mode(0o666);
        #[cfg(unix)]
        options.permissions(everyone); // less the umask, as any new file
        let (file, temporary) = options
            .tempfile_in(folder)
            .map_err(Error::io(path))?
            .into_parts();
        let unfinished = TempFile {
            path: path.to_path_buf(),
            target: target.to_path_buf(),
            temporary,
        };
        Ok((file, unfinished))
    }

    /// Returns its temporary name.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Renames it to its final name.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn finish(self) -> Result<()> {
        let path = self.path;
        self.temporary
            .persist(self.target)
            .map_err(|e| Error::io(path)(e.error))
    }
}
