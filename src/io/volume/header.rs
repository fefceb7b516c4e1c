//! Headers of written volumes.

use crate::mesh::ScalarType;
use crate::volume::{Grid, Volume};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// NIfTI code for vector images. ITK keeps them as they are, in its own frame, LPS; displacements
/// (1006) are converted from RAS only by newer versions.
const INTENT_VECTOR: i16 = 1007;

/// Layout of the voxels described by a header.
#[derive(Clone)]
pub(crate) struct Layout<'a> {
    pub grid: Grid,
    pub scalar: ScalarType,
    /// Numbers per voxel: 1, or 3 for a vector, in LPS.
    pub components: usize,
    pub slope: f64,
    pub intercept: f64,
    pub names: Option<&'a BTreeMap<i64, String>>,
}

impl<'a> Layout<'a> {
    pub fn of(volume: &'a Volume) -> Layout<'a> {
        Layout {
            grid: volume.grid(),
            scalar: volume.raw.scalar_type(),
            components: 1,
            slope: volume.slope,
            intercept: volume.intercept,
            names: Some(&volume.label_names),
        }
    }

    /// Returns the header of an attached NRRD with gzip-compressed voxels.
    pub fn nrrd(&self) -> Result<Vec<u8>> {
        if (self.slope, self.intercept) != (1.0, 0.0) {
            return Err(Error::Input(
                "NRRD cannot store slope and intercept; write .nii.gz or .mha, or apply them first"
                    .into(),
            ));
        }
        let kind = match self.scalar {
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
        let [i, j, k] = self.grid.size;
        // Vectors are in the frame of the space.
        let (space, turn) = match self.components {
            1 => ("right-anterior-superior", DMat3::IDENTITY),
            _ => ("left-posterior-superior", ras_to_lps()),
        };
        let (dimension, first, none, of_vectors) = match self.components {
            1 => (3, String::new(), "", ""),
            n => (4, format!("{n} "), "none ", "vector "),
        };
        let vector = |v: DVec3| {
            let v = turn * v;
            format!("({},{},{})", v.x, v.y, v.z)
        };
        let axes = self.grid.to_world.matrix3;
        let mut text = String::from("NRRD0004\n");
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "type: {kind}\ndimension: {dimension}\nspace: {space}\nsizes: {first}{i} {j} {k}\nspace directions: {none}{} {} {}\nkinds: {of_vectors}domain domain domain\nendian: little\nencoding: gzip\nspace origin: {}\nspace units: \"mm\" \"mm\" \"mm\"\n",
            vector(axes.x_axis),
            vector(axes.y_axis),
            vector(axes.z_axis),
            vector(self.grid.to_world.translation)
        );
        for (n, (label, name)) in self.names.into_iter().flatten().enumerate() {
            let name = name.replace(['\n', '\r'], " ");
            let _ = write!(
                text,
                "Segment{n}_LabelValue:={label}\nSegment{n}_Name:={name}\n"
            );
        }
        text.push('\n');
        Ok(text.into_bytes())
    }

    /// Returns the header of a MetaImage followed by `packed` bytes of zlib-compressed voxels.
    pub fn metaimage(&self, packed: u64) -> Vec<u8> {
        let kind = match self.scalar {
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
        let channels = match self.components {
            1 => String::new(),
            n => format!("ElementNumberOfChannels = {n}\n"),
        };
        let spacing = self.grid.spacing();
        let axes = ras_to_lps() * self.grid.to_world.matrix3;
        let axes = axes * DMat3::from_diagonal(spacing.recip());
        let numbers = |v: &[f64]| {
            let words: Vec<String> = v.iter().map(f64::to_string).collect();
            words.join(" ")
        };
        let [i, j, k] = self.grid.size;
        format!(
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = True\nCompressedDataSize = {packed}\nTransformMatrix = {}\nOffset = {}\nElementSpacing = {}\nDimSize = {i} {j} {k}\n{channels}ElementToIntensityFunctionSlope = {}\nElementToIntensityFunctionOffset = {}\nElementType = {kind}\nElementDataFile = LOCAL\n",
            numbers(&axes.to_cols_array()),
            numbers(&(ras_to_lps() * self.grid.to_world.translation).to_array()),
            numbers(&spacing.to_array()),
            self.slope,
            self.intercept
        )
        .into_bytes()
    }

    /// Returns the header of a single-file NIfTI-1; vectors are stored component by component.
    pub fn nifti(&self) -> Result<Vec<u8>> {
        const HEADER: usize = 352;
        let mut bytes = vec![0u8; HEADER];
        let mut put = |place: usize, value: &[u8]| {
            bytes[place..place + value.len()].copy_from_slice(value);
        };
        put(0, &348i32.to_le_bytes());
        let vectors = self.components > 1;
        put(40, &(if vectors { 5i16 } else { 3 }).to_le_bytes());
        for (n, size) in self.grid.size.iter().enumerate() {
            let size = i16::try_from(*size).map_err(|_| {
                Error::Input(format!(
                    "NIfTI-1 supports at most 32767 voxels per axis, got {size}; write .nrrd"
                ))
            })?;
            put(42 + 2 * n, &size.to_le_bytes());
        }
        for n in 3..7 {
            put(42 + 2 * n, &1i16.to_le_bytes());
        }
        if vectors {
            put(50, &(self.components as i16).to_le_bytes());
            put(68, &INTENT_VECTOR.to_le_bytes());
        }
        let (code, bits): (i16, i16) = match self.scalar {
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
        for (n, spacing) in self.grid.spacing().to_array().iter().enumerate() {
            put(80 + 4 * n, &(*spacing as f32).to_le_bytes());
        }
        if vectors {
            put(92, &1f32.to_le_bytes());
            put(96, &1f32.to_le_bytes());
        }
        put(108, &(HEADER as f32).to_le_bytes());
        put(112, &(self.slope as f32).to_le_bytes());
        put(116, &(self.intercept as f32).to_le_bytes());
        // Millimetres; the sform is in scanner coordinates.
        put(123, &[2]);
        put(254, &1i16.to_le_bytes());
        for row in 0..3 {
            let axes = self.grid.to_world.matrix3.row(row).to_array();
            let shift = self.grid.to_world.translation[row];
            for (n, value) in axes.into_iter().chain([shift]).enumerate() {
                put(280 + 16 * row + 4 * n, &(value as f32).to_le_bytes());
            }
        }
        put(344, b"n+1\0");
        Ok(bytes)
    }
}

/// Returns the map from RAS (Palpate, NIfTI) to LPS (ITK, DICOM).
fn ras_to_lps() -> DMat3 {
    DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0))
}
