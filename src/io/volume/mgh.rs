//! Reader for FreeSurfer's volumes: .mgh, and .mgz, the same compressed with gzip.
//!
//! The format is described at surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat; all numbers are
//! big-endian, and the world is RAS, in mm.

use super::Fetch;
use super::voxels::{Packing, bytes_in, chosen, decode, extent, unpack_start};
use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use crate::volume::Volume;
use glam::{DAffine3, DMat3, DVec3};

/// Position of the voxels.
const HEADER: usize = 284;

/// Whether a decompressed file begins as an MGH volume.
pub(super) fn is_mgh(bytes: &[u8], extension: &str) -> bool {
    // Version 1 of any file begins alike, so that more of the header must fit.
    let sound = || {
        let positive = (1..5).all(|n| (1..1 << 24).contains(&int(bytes, n)));
        positive && matches!(int(bytes, 5), 0 | 1 | 3 | 4 | 10)
    };
    let begins = bytes.len() >= HEADER && int(bytes, 0) == 1;
    begins && (sound() || matches!(extension, "mgh" | "mgz"))
}

/// Returns integer `n` of the header; 0 past its end.
fn int(bytes: &[u8], n: usize) -> i32 {
    let number = bytes.get(4 * n..4 * n + 4).and_then(|b| b.try_into().ok());
    i32::from_be_bytes(number.unwrap_or_default())
}

/// Parses the bytes of `file` as a volume. Frame `number` is read if there are several.
pub(super) fn read(file: &[u8], _: Fetch, number: Option<usize>) -> ParseResult<Volume> {
    let packing = Packing::of(file);
    let start = packing.take(file, HEADER as u64);
    let start = start.map_err(|e| format!("cannot decompress the file: {e}"))?;
    if start.len() < HEADER || int(&start, 0) != 1 {
        return Err(format!(
            "expected the header of an MGH volume: {HEADER} bytes that begin with the version 1"
        ));
    }
    let counts = [1, 2, 3, 4].map(|n| usize::try_from(int(&start, n)).unwrap_or(0));
    let [i, j, k, frames] = counts;
    if counts.contains(&0) {
        return Err(format!(
            "width, height, depth and number of frames must be ≥ 1, got {counts:?}"
        ));
    }
    let size = [i, j, k];
    let scalar = match int(&start, 5) {
        0 => ScalarType::U8,
        1 => ScalarType::I32,
        3 => ScalarType::F32,
        4 => ScalarType::I16,
        10 => ScalarType::U16,
        other => {
            return Err(format!(
                "type {other} is not supported; use 0 (uchar), 1 (int), 3 (float), 4 (short) or 10 \
                (ushort): `mri_convert -odt float`"
            ));
        }
    };
    let (_, bytes) = extent(size, scalar)?;
    let frame = chosen(number, frames, "`nframes`")?;
    let first = frame.checked_mul(bytes).and_then(|n| n.checked_add(HEADER));
    let range = first.and_then(|first| Some(first..first.checked_add(bytes)?));
    let range = range.ok_or("the size of the volume is larger than any file")?;
    // Scan parameters and tags follow the voxels.
    let unpacked = unpack_start(file, packing, range.end)?;
    let mut notes = Vec::new();
    Ok(Volume {
        size,
        raw: decode(&unpacked[range], scalar, bytes_in(scalar) > 1),
        to_world: to_world(&start, size, &mut notes)?,
        notes,
        ..Volume::default()
    })
}

/// Returns the map from indices to RAS: the header states the position of the central voxel.
fn to_world(start: &[u8], size: [usize; 3], notes: &mut Vec<String>) -> ParseResult<DAffine3> {
    // The numbers follow a flag of 2 bytes.
    let flagged = start[28..30] != [0, 0];
    let real = |n: usize| f64::from(f32::from_bits(int(&start[30..], n) as u32));
    let vector = |n: usize| DVec3::new(real(n), real(n + 1), real(n + 2));
    let (spacing, axes, centre) = match flagged {
        true => {
            let axes = DMat3::from_cols(vector(3), vector(6), vector(9));
            (vector(0), axes, vector(12))
        }
        false => {
            notes.push(
                "the header has no position (its flag for RAS is 0): coronal slices of 1 mm around \
                the origin are assumed, as in FreeSurfer"
                    .into(),
            );
            let axes = DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y);
            (DVec3::ONE, axes, DVec3::ZERO)
        }
    };
    let linear = axes * DMat3::from_diagonal(spacing);
    let middle = DVec3::from(size.map(|n| 0.5 * n as f64));
    let origin = centre - linear * middle;
    match linear.determinant() != 0.0 && linear.is_finite() && origin.is_finite() {
        true => Ok(DAffine3::from_mat3_translation(linear, origin)),
        false => Err(format!(
            "voxels have zero volume; check the spacing {spacing} and the direction cosines of the \
            header"
        )),
    }
}
