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
    volume_of(&bytes, &fetch).map_err(|e| Error::format(path, e))
}

/// Whether a file begins as a volume does.
pub(super) fn is_volume(bytes: &[u8]) -> bool {
    reader_of(bytes).is_some()
}

type Reader = fn(&[u8], Fetch) -> Parse<Volume>;

fn reader_of(bytes: &[u8]) -> Option<Reader> {
    if bytes.starts_with(nrrd::MAGIC) {
        Some(nrrd::read)
    } else if nifti::is_nifti(bytes) {
        Some(nifti::read)
    } else if metaimage::is_metaimage(bytes) {
        Some(metaimage::read)
    } else {
        None
    }
}

/// The volume in the content of a file.
pub(super) fn volume_of(bytes: &[u8], fetch: Fetch) -> Parse<Volume> {
    let reader = reader_of(bytes).ok_or(
        "this is no volume that Palpate reads: NIfTI (.nii, .nii.gz, .hdr), NRRD (.nrrd, .nhdr) and MetaImage (.mhd, .mha) are",
    )?;
    reader(bytes, fetch)
}
