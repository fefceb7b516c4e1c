//! Files that are either whole or not there.

use crate::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes a file through a temporary name in the same folder, and gives it its own name only
/// once `fill` has succeeded: whoever looks sees the old file or the whole new one. What is no
/// regular file (a pipe, `/dev/null`) is written to directly.
///
/// # Errors
/// Whatever `fill` returns, or that the file cannot be made, written or renamed; the temporary
/// file is gone then and an older file of that name untouched.
pub fn atomic_write(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<()>,
) -> Result<()> {
    let mut fill = Some(fill);
    whole_or_not(path.as_ref(), &mut |file| match fill.take() {
        Some(fill) => fill(file),
        None => Ok(()),
    })
}

/// Fills a file, once.
type Fill<'a> = &'a mut dyn FnMut(&mut BufWriter<File>) -> Result<()>;

fn whole_or_not(path: &Path, fill: Fill<'_>) -> Result<()> {
    // A link keeps pointing where it did: the file behind it is the one replaced.
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
        return Err(Error::format(
            path,
            "this is a folder; name a file to write",
        ));
    }
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    replace(path, &target, folder, fill)
}

#[cfg(target_arch = "wasm32")]
fn replace(path: &Path, _: &Path, _: &Path, _: Fill<'_>) -> Result<()> {
    Err(Error::format(path, "a browser has no files to write"))
}

/// Fills a temporary file in `folder` and gives it the name `target`; `path` is what errors name.
#[cfg(not(target_arch = "wasm32"))]
fn replace(path: &Path, target: &Path, folder: &Path, fill: Fill<'_>) -> Result<()> {
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
    let mut file = BufWriter::new(file);
    fill(&mut file)?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    temporary
        .persist(target)
        .map_err(|e| Error::io(path)(e.error))
}
