//! Writers for volumes: .nrrd, .mha and .nii.gz, compressed, little-endian.

use crate::io::{atomic_write, extension};
use crate::mesh::ScalarType;
use crate::volume::{Raw, Volume};
use crate::{Error, Result};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DMat3, DVec3};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Writes a volume as `.nrrd`, `.mha` or `.nii.gz`, in one go: the file is either whole or not
/// there. Values, transform and scaling read back as they are (the transform of NIfTI in single
/// precision; names of labels, and no scaling, in NRRD only).
///
/// # Errors
/// Another extension, a volume that the format cannot hold, or the file cannot be written.
pub fn write_volume(path: impl AsRef<Path>, volume: &Volume) -> Result<()> {
    let path = path.as_ref();
    if volume.raw.len() != volume.voxels() || volume.voxels() == 0 {
        return Err(Error::Input(format!(
            "{}: a volume of {:?} voxels has {} values",
            path.display(),
            volume.size,
            volume.raw.len()
        )));
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let bytes = match extension(path).as_str() {
        "nrrd" => nrrd(volume),
        "mha" => metaimage(volume),
        "gz" if name.to_lowercase().ends_with(".nii.gz") => nifti(volume),
        other => Err(Error::Input(format!(
            "{}: volumes are written as .nrrd, .mha or .nii.gz, not as \".{other}\"",
            path.display()
        ))),
    }?;
    atomic_write(path, |file| file.write_all(&bytes).map_err(Error::io(path)))
}

fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    packed.map_err(Error::io("compression"))
}

fn nrrd(volume: &Volume) -> Result<Vec<u8>> {
    if (volume.slope, volume.intercept) != (1.0, 0.0) {
        return Err(Error::Input(
            "NRRD has no slope and intercept; write .nii.gz or .mha, or apply them first".into(),
        ));
    }
    let kind = match volume.raw.scalar_type() {
        ScalarType::I8 => "int8",
        ScalarType::U8 => "uint8",
        ScalarType::I16 => "int16",
        ScalarType::U16 => "uint16",
        ScalarType::I32 => "int32",
        ScalarType::U32 => "uint32",
        ScalarType::I64 => "int64",
        ScalarType::U64 => "uint64",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    };
    let [i, j, k] = volume.size;
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let axes = volume.to_world.matrix3;
    let mut text = String::from("NRRD0004\n");
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "type: {kind}\ndimension: 3\nspace: right-anterior-superior\nsizes: {i} {j} {k}\nspace directions: {} {} {}\nkinds: domain domain domain\nendian: little\nencoding: gzip\nspace origin: {}\nspace units: \"mm\" \"mm\" \"mm\"\n",
        vector(axes.x_axis),
        vector(axes.y_axis),
        vector(axes.z_axis),
        vector(volume.to_world.translation)
    );
    for (n, (label, name)) in volume.names.iter().enumerate() {
        let name = name.replace(['\n', '\r'], " ");
        let _ = write!(
            text,
            "Segment{n}_LabelValue:={label}\nSegment{n}_Name:={name}\n"
        );
    }
    text.push('\n');
    Ok([text.into_bytes(), gzip(&volume.raw.to_bytes())?].concat())
}

fn metaimage(volume: &Volume) -> Result<Vec<u8>> {
    let kind = match volume.raw.scalar_type() {
        ScalarType::I8 => "MET_CHAR",
        ScalarType::U8 => "MET_UCHAR",
        ScalarType::I16 => "MET_SHORT",
        ScalarType::U16 => "MET_USHORT",
        ScalarType::I32 => "MET_INT",
        ScalarType::U32 => "MET_UINT",
        ScalarType::I64 => "MET_LONG_LONG",
        ScalarType::U64 => "MET_ULONG_LONG",
        ScalarType::F32 => "MET_FLOAT",
        ScalarType::F64 => "MET_DOUBLE",
    };
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let packed = encoder
        .write_all(&volume.raw.to_bytes())
        .and_then(|()| encoder.finish())
        .map_err(Error::io("compression"))?;
    let ras_to_lps = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let spacing = volume.spacing();
    let axes = ras_to_lps * volume.to_world.matrix3 * DMat3::from_diagonal(spacing.recip());
    let numbers = |v: &[f64]| {
        let words: Vec<String> = v.iter().map(f64::to_string).collect();
        words.join(" ")
    };
    let [i, j, k] = volume.size;
    let text = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = True\nCompressedDataSize = {}\nTransformMatrix = {}\nOffset = {}\nElementSpacing = {}\nDimSize = {i} {j} {k}\nElementToIntensityFunctionSlope = {}\nElementToIntensityFunctionOffset = {}\nElementType = {kind}\nElementDataFile = LOCAL\n",
        packed.len(),
        numbers(&axes.to_cols_array()),
        numbers(&(ras_to_lps * volume.to_world.translation).to_array()),
        numbers(&spacing.to_array()),
        volume.slope,
        volume.intercept
    );
    Ok([text.into_bytes(), packed].concat())
}

fn nifti(volume: &Volume) -> Result<Vec<u8>> {
    const HEADER: usize = 352;
    let mut bytes = vec![0u8; HEADER];
    let mut put = |place: usize, value: &[u8]| {
        bytes[place..place + value.len()].copy_from_slice(value);
    };
    put(0, &348i32.to_le_bytes());
    put(40, &3i16.to_le_bytes());
    for (n, size) in volume.size.iter().enumerate() {
        let size = i16::try_from(*size).map_err(|_| {
            Error::Input(format!(
                "NIfTI-1 holds at most 32767 voxels along an axis, not {size}; write .nrrd"
            ))
        })?;
        put(42 + 2 * n, &size.to_le_bytes());
    }
    for n in 3..7 {
        put(42 + 2 * n, &1i16.to_le_bytes());
    }
    let (code, bits): (i16, i16) = match volume.raw.scalar_type() {
        ScalarType::U8 => (2, 8),
        ScalarType::I16 => (4, 16),
        ScalarType::I32 => (8, 32),
        ScalarType::F32 => (16, 32),
        ScalarType::F64 => (64, 64),
        ScalarType::I8 => (256, 8),
        ScalarType::U16 => (512, 16),
        ScalarType::U32 => (768, 32),
        ScalarType::I64 => (1024, 64),
        ScalarType::U64 => (1280, 64),
    };
    put(70, &code.to_le_bytes());
    put(72, &bits.to_le_bytes());
    put(76, &1f32.to_le_bytes());
    for (n, spacing) in volume.spacing().to_array().iter().enumerate() {
        put(80 + 4 * n, &(*spacing as f32).to_le_bytes());
    }
    put(108, &(HEADER as f32).to_le_bytes());
    put(112, &(volume.slope as f32).to_le_bytes());
    put(116, &(volume.intercept as f32).to_le_bytes());
    // Millimetres; the sform in scanner coordinates.
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for row in 0..3 {
        let axes = volume.to_world.matrix3.row(row).to_array();
        let shift = volume.to_world.translation[row];
        for (n, value) in axes.into_iter().chain([shift]).enumerate() {
            put(280 + 16 * row + 4 * n, &(value as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    bytes.extend(volume.raw.to_bytes());
    gzip(&bytes)
}

impl Raw {
    /// All numbers, little-endian.
    fn to_bytes(&self) -> Vec<u8> {
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
