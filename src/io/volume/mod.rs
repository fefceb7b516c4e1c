//! Readers and writers of volumes, one file per format. All are converted to RAS, in mm.

#[cfg(feature = "dicom")]
pub(super) mod dicom;
mod header;
mod metaimage;
mod nifti;
mod nrrd;
mod nrrd_space;
mod pattern;
mod stream;
mod voxels;
mod vtk_image;
mod write;

pub(crate) use header::Layout;
pub(crate) use stream::{VolumeFormat, VolumeStream};
pub use write::write_volume;

use super::cursor::ParseResult;
use crate::files;
use crate::volume::Volume;
use crate::{Error, Result};
use std::path::Path;

/// Reads the data file named in a header, relative to the header's folder. A leading `*` stands for
/// the header's own name without its extension.
type Fetch<'a> = &'a dyn Fn(&str) -> ParseResult<Vec<u8>>;

/// Reads a volume in any supported format: NIfTI, NRRD, MetaImage, VTK images. The format is detected from the
/// content, then from the extension.
///
/// A folder is a series of DICOM slices (with the cargo feature `dicom`): the series with the most
/// images is read; it must be complete and evenly spaced.
///
/// # Errors
/// An error if the file cannot be read, is damaged, or contains anything but one scalar volume.
pub fn read_volume(path: impl AsRef<Path>) -> Result<Volume> {
    let path = path.as_ref();
    if path.is_dir() {
        return read_folder(path);
    }
    let bytes = super::content(path)?;
    let fetch = |name: &str| {
        let file = match name.trim().strip_prefix("*.") {
            Some(extension) => path.with_extension(extension),
            None => path.with_file_name("").join(name.trim()),
        };
        files::read_regular(&file).map_err(|e| format!("cannot read the data file: {e}"))
    };
    volume_of(&bytes, &extension(path), &fetch).map_err(|e| Error::format(path, e))
}

/// Returns the extension of a file, `nii` for `.nii.gz`.
pub(super) fn extension(path: &Path) -> String {
    match super::extension(path).as_str() {
        "gz" => super::extension(Path::new(path.file_stem().unwrap_or_default())),
        other => other.to_owned(),
    }
}

#[cfg(feature = "dicom")]
fn read_folder(path: &Path) -> Result<Volume> {
    dicom::read(path)
}

#[cfg(not(feature = "dicom"))]
fn read_folder(path: &Path) -> Result<Volume> {
    Err(Error::format(
        path,
        "expected a file, found a folder; to read folders of DICOM slices, build Palpate with \
        `cargo build --features dicom`",
    ))
}

/// Whether a file is a volume by its content or extension.
pub(super) fn is_volume(bytes: &[u8], extension: &str) -> bool {
    reader_of(bytes, extension).is_some()
}

type Reader = fn(&[u8], Fetch) -> ParseResult<Volume>;

fn reader_of(bytes: &[u8], extension: &str) -> Option<Reader> {
    if bytes.starts_with(nrrd::MAGIC) {
        Some(nrrd::read)
    } else if nifti::is_nifti(bytes) {
        Some(nifti::read)
    } else if metaimage::is_metaimage(bytes) {
        Some(metaimage::read)
    } else if vtk_image::is_image(bytes) {
        Some(|file, _| vtk_image::read(file, None))
    } else {
        // Unknown content: the reader selected by the extension reports what it expected.
        match extension {
            "nrrd" | "nhdr" => Some(nrrd::read),
            "nii" | "hdr" => Some(nifti::read),
            "mha" | "mhd" => Some(metaimage::read),
            "vti" => Some(|file, _| vtk_image::read(file, None)),
            _ => None,
        }
    }
}

/// Parses the volume in the content of a file.
pub(super) fn volume_of(bytes: &[u8], extension: &str, fetch: Fetch) -> ParseResult<Volume> {
    let reader = reader_of(bytes, extension).ok_or(
        "unknown volume format; supported: NIfTI (.nii, .nii.gz, .hdr), NRRD (.nrrd, .nhdr), \
        MetaImage (.mhd, .mha) and VTK images (.vti, .vtk)",
    )?;
    reader(bytes, fetch)
}

/// Concatenates the data of several files. Stops if there are far more bytes than `bytes` of voxels
/// can take, even as text.
fn joined(names: &[String], bytes: usize, fetch: Fetch) -> ParseResult<Vec<u8>> {
    let limit = bytes.saturating_mul(32).saturating_add(1 << 20);
    let mut data = Vec::new();
    for name in names {
        data.extend(fetch(name)?);
        if data.len() > limit && names.len() > 1 {
            return Err(format!(
                "the {} data files have far more than the {bytes} bytes of voxels that the header \
                specifies",
                names.len()
            ));
        }
    }
    Ok(data)
}
