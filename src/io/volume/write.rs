//! Writers for volumes: .nrrd, .mha and .nii.gz, compressed, little-endian.

use super::header::Layout;
use super::stream::VolumeFormat;
use crate::io::atomic_write;
use crate::volume::{Raw, Volume};
use crate::{Error, Result};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::io::Write;
use std::path::Path;

/// Writes a volume as `.nrrd`, `.mha` or `.nii.gz`, atomically. Values, transform and scaling are
/// preserved (the transform of NIfTI in single precision; names of labels, and no scaling, in NRRD
/// only).
///
/// # Errors
/// An error for another extension, for a volume that the format cannot represent, or if the file
/// cannot be written.
pub fn write_volume(path: impl AsRef<Path>, volume: &Volume) -> Result<()> {
    let path = path.as_ref();
    if volume.raw.len() != volume.voxels() || volume.voxels() == 0 {
        return Err(Error::Input(format!(
            "{}: volume of {:?} voxels must have one value per voxel, got {} values",
            path.display(),
            volume.size,
            volume.raw.len()
        )));
    }
    let layout = Layout::of(volume);
    let voxels = volume.raw.to_bytes();
    let bytes = match VolumeFormat::from_path(path)? {
        VolumeFormat::Nrrd => [layout.nrrd()?, gzip(&voxels)?].concat(),
        VolumeFormat::Nifti => gzip(&[layout.nifti()?, voxels].concat())?,
        VolumeFormat::MetaImage => {
            let packed = zlib(&voxels)?;
            [layout.metaimage(packed.len() as u64), packed].concat()
        }
    };
    atomic_write(path, |file| file.write_all(&bytes).map_err(Error::io(path)))
}

fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    packed.map_err(Error::io("compression"))
}

fn zlib(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    packed.map_err(Error::io("compression"))
}

impl Raw {
    /// Encodes all numbers, little-endian.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        match self {
            Raw::I8(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::U8(v) => v.clone(),
            Raw::I16(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::U16(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::I32(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::U32(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::I64(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::U64(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::F32(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Raw::F64(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
        }
    }
}
