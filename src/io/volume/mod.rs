//! Volumes in and out: one file a format. Everything is brought to RAS, in mm.

mod metaimage;
mod nifti;
mod nrrd;
mod pattern;
mod voxels;
mod write;

pub use write::write_volume;

use super::cursor::Parse;
use crate::volume::Volume;
use crate::{Error, Result};
use std::path::Path;

/// Fetches the bytes of a data file that a header names, relative to the header's folder. A name
/// that begins with `*` has the header's own name there, without its extension.
type Fetch<'a> = &'a dyn Fn(&str) -> Parse<Vec<u8>>;

/// Reads a volume of any format that is known. The content decides, then the extension.
///
/// # Errors
/// A file that cannot be read, is damaged, or holds something else than one scalar volume.
pub fn read_volume(path: impl AsRef<Path>) -> Result<Volume> {
    let path = path.as_ref();
    let bytes = super::content(path)?;
    let fetch = |name: &str| {
        let file = match name.trim().strip_prefix("*.") {
            Some(extension) => path.with_extension(extension),
            None => path.with_file_name("").join(name.trim()),
        };
        super::content(&file).map_err(|e| format!("its data file cannot be read: {e}"))
    };
    let reader = if bytes.starts_with(nrrd::MAGIC) {
        nrrd::read
    } else if nifti::is_nifti(&bytes) {
        nifti::read
    } else if metaimage::is_metaimage(&bytes) {
        metaimage::read
    } else {
        return Err(Error::format(
            path,
            "neither the content nor the extension is of a known volume format; Palpate reads NIfTI, NRRD and MetaImage",
        ));
    };
    reader(&bytes, &fetch).map_err(|e| Error::format(path, e))
}
