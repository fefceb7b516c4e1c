//! Readers and writers of volumes, one file per format. All are converted to RAS, in mm.

mod analyze;
#[cfg(feature = "dicom")]
pub(super) mod dicom;
mod header;
mod metaimage;
mod mgh;
mod nifti;
mod nrrd;
mod nrrd_space;
mod pattern;
mod segmentation;
mod stream;
mod voxels;
mod vtk_image;
mod write;

pub(crate) use header::Layout;
pub(crate) use stream::{VolumeFormat, VolumeStream};
pub use write::write_volume;

use super::cursor::ParseResult;
use super::other_formats;
use crate::files;
use crate::volume::Volume;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use voxels::Packing;

/// Reads the data file named in a header, relative to the header's folder. A leading `*` stands for
/// the header's own name without its extension.
type Fetch<'a> = &'a dyn Fn(&str) -> ParseResult<Vec<u8>>;

/// Reads a volume in any supported format: NIfTI, Analyze, NRRD, MetaImage, VTK images, FreeSurfer's
/// MGH, and with the cargo feature `dicom` DICOM; any of them compressed with gzip or bzip2. The
/// format is detected from the content, then from the extension. For `.img` with `.hdr`, either can
/// be named.
///
/// A folder is a series of DICOM slices: the series with the most images is read; it must be
/// complete and evenly spaced.
///
/// What was repaired or assumed is in [`Volume::notes`].
///
/// # Errors
/// An error if the file cannot be read, is damaged, or contains anything but one scalar volume.
pub fn read_volume(path: impl AsRef<Path>) -> Result<Volume> {
    read_volume_number(path, None)
}

/// As [`read_volume`]; of a file of several volumes (times, echoes, components) reads number
/// `number`, counted from 0.
///
/// # Errors
/// As [`read_volume`]; an error that states how many volumes there are, if `number` is not one of
/// them, or is `None` for several.
pub fn read_volume_number(path: impl AsRef<Path>, number: Option<usize>) -> Result<Volume> {
    let path = path.as_ref();
    if path.is_dir() {
        return read_folder(path, number);
    }
    let header = header_beside(path);
    let path = header.as_deref().unwrap_or(path);
    let bytes = super::content(path)?;
    let fetch = |name: &str| {
        let file = match name.trim().strip_prefix("*.") {
            Some(extension) => without_packing(path).with_extension(extension),
            None => path.with_file_name("").join(name.trim()),
        };
        files::read_regular(&file).map_err(|e| format!("cannot read the data file: {e}"))
    };
    volume_of(&bytes, &extension(path), &fetch, number).map_err(|e| Error::format(path, e))
}

/// Returns `path` without the extension of a compression.
fn without_packing(path: &Path) -> PathBuf {
    match super::extension(path).as_str() {
        "gz" | "bz2" => path.with_extension(""),
        _ => path.to_owned(),
    }
}

/// Returns the extension of a file, `nii` for `.nii.gz`.
pub(super) fn extension(path: &Path) -> String {
    super::extension(&without_packing(path))
}

/// Returns the header of an `.img` file, if there is one.
fn header_beside(path: &Path) -> Option<PathBuf> {
    let plain = without_packing(path);
    if super::extension(&plain) != "img" {
        return None;
    }
    let named = |extension: &str| plain.with_extension(extension);
    let mut headers = ["hdr", "hdr.gz", "HDR", "hdr.bz2"].into_iter().map(named);
    headers.find(|header| files::exists(header))
}

#[cfg(feature = "dicom")]
fn read_folder(path: &Path, number: Option<usize>) -> Result<Volume> {
    dicom::read(path, number).map(finished)
}

#[cfg(not(feature = "dicom"))]
fn read_folder(path: &Path, _: Option<usize>) -> Result<Volume> {
    Err(Error::format(
        path,
        "expected a file, found a folder; to read folders of DICOM slices, build Palpate with \
        `cargo build --features dicom`",
    ))
}

/// Whether a file is a volume by its content or extension.
pub(super) fn is_volume(bytes: &[u8], extension: &str) -> bool {
    !matches!(
        format_of(&beginning(bytes), extension),
        VolumeSource::Unknown
    )
}

type Reader = fn(&[u8], Fetch, Option<usize>) -> ParseResult<Volume>;

/// What a file contains.
enum VolumeSource {
    /// A volume, and whether its reader decompresses the file itself.
    Known(Reader, bool),
    /// A volume in a format that is not supported, with the reason and a remedy.
    Unsupported(String),
    Unknown,
}

/// Bytes at the start of a file by which its format is detected.
const BEGINNING: u64 = 4096;

/// Returns the start of the file, decompressed. A failed decompression gives an empty, unknown start.
fn beginning(file: &[u8]) -> Vec<u8> {
    let packing = Packing::of(file);
    packing.take(file, BEGINNING).unwrap_or_default()
}

/// Detects the format from the beginning of a file and its extension.
fn format_of(bytes: &[u8], extension: &str) -> VolumeSource {
    use VolumeSource::{Known, Unknown, Unsupported};
    if bytes.starts_with(nrrd::MAGIC) {
        return Known(nrrd::read, false);
    } else if nifti::is_nifti(bytes) {
        return Known(nifti::read, true);
    } else if bytes.get(128..132) == Some(b"DICM") {
        return dicom_reader();
    } else if metaimage::is_metaimage(bytes) {
        return Known(metaimage::read, false);
    } else if vtk_image::is_image(bytes) {
        return Known(|file, _, number| vtk_image::read(file, number), false);
    } else if mgh::is_mgh(bytes, extension) {
        return Known(mgh::read, true);
    }
    // Unknown content: the reader selected by the extension reports what it expected.
    match extension {
        "nrrd" | "nhdr" => Known(nrrd::read, false),
        "nii" | "hdr" => Known(nifti::read, true),
        "mha" | "mhd" => Known(metaimage::read, false),
        "vti" => Known(|file, _, number| vtk_image::read(file, number), false),
        "mgh" | "mgz" => Known(mgh::read, true),
        // With its header, that is read instead.
        "img" => Unsupported(
            "the file has voxels without a header; its header, the .hdr of the same name, must be \
            beside it"
                .into(),
        ),
        _ => Unknown,
    }
}

#[cfg(feature = "dicom")]
fn dicom_reader() -> VolumeSource {
    VolumeSource::Known(|file, _, number| dicom::read_file(file, number), false)
}

#[cfg(not(feature = "dicom"))]
fn dicom_reader() -> VolumeSource {
    VolumeSource::Unsupported(
        "DICOM is not supported by this build of Palpate; build it with the cargo feature `dicom`, \
        or convert the file to NIfTI (for example with dcm2niix)"
            .into(),
    )
}

const UNKNOWN_FORMAT: &str = "unknown volume format; supported: NIfTI and Analyze (.nii, .nii.gz, \
    .hdr with .img), NRRD (.nrrd, .nhdr), MetaImage (.mhd, .mha), VTK images (.vti, .vtk), FreeSurfer \
    (.mgz, .mgh) and DICOM";

/// Parses the volume in the content of a file: number `number` of several.
pub(super) fn volume_of(
    bytes: &[u8],
    extension: &str,
    fetch: Fetch,
    number: Option<usize>,
) -> ParseResult<Volume> {
    let (reader, unpacks) = match format_of(&beginning(bytes), extension) {
        VolumeSource::Known(reader, unpacks) => (reader, unpacks),
        VolumeSource::Unsupported(what) => return Err(what),
        VolumeSource::Unknown => {
            return Err(other_formats::by_content(bytes, extension)
                .or_else(|| other_formats::by_extension(extension))
                .unwrap_or_else(|| UNKNOWN_FORMAT.into()));
        }
    };
    let packing = Packing::of(bytes);
    let bytes = match packing {
        Packing::Gzip | Packing::Bzip2 if !unpacks => Cow::Owned(
            packing
                .take(bytes, u64::MAX)
                .map_err(|e| format!("cannot decompress the file: {e}"))?,
        ),
        _ => Cow::Borrowed(bytes),
    };
    reader(&bytes, fetch, number).map(finished)
}

/// Completes what is common to all formats.
fn finished(mut volume: Volume) -> Volume {
    volume.round_near_labels();
    volume
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
