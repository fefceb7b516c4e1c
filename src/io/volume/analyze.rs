//! The world of an Analyze 7.5 image (.hdr with .img), whose header is otherwise that of NIfTI-1.
//!
//! The format states no position, and sides only by a code for the order of the slices.

use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use glam::{DAffine3, DMat3, DVec3};

/// Returns the number type of a code that only Analyze has, as written by SPM.
pub(super) fn scalar_type(code: i64) -> Option<ScalarType> {
    match code {
        130 => Some(ScalarType::I8),
        132 => Some(ScalarType::U16),
        136 => Some(ScalarType::U32),
        _ => None,
    }
}

/// Returns the directions in RAS of the voxel axes for the code `orient`: `x` from right to left in
/// the usual ones, as radiologists look at slices.
fn directions(orient: u8) -> ParseResult<[DVec3; 3]> {
    let [left, anterior, superior] = [DVec3::NEG_X, DVec3::Y, DVec3::Z];
    Ok(match orient {
        0 => [left, anterior, superior],
        1 => [left, superior, anterior],
        2 => [anterior, superior, left],
        3 => [left, -anterior, superior],
        4 => [left, -superior, anterior],
        5 => [anterior, -superior, left],
        other => {
            return Err(format!(
                "`orient` must be 0 to 5 in an Analyze header, got {other}; convert it to NIfTI \
                (for example with 3D Slicer)"
            ));
        }
    })
}

/// Returns the map from indices to RAS for `spacings`, with a note on what is assumed. `origin` is the
/// voxel at the origin, counted from 1, as SPM stores it; without one it is the centre.
pub(super) fn to_world(
    orient: u8,
    origin: [i64; 3],
    size: [usize; 3],
    spacings: DVec3,
    notes: &mut Vec<String>,
) -> ParseResult<DAffine3> {
    let axes = directions(orient)?;
    let linear = DMat3::from_cols(axes[0], axes[1], axes[2]) * DMat3::from_diagonal(spacings);
    let inside = |n: usize| {
        let size = size[n] as i64;
        origin[n] > -size && origin[n] < 2 * size
    };
    let stored = origin != [0; 3] && (0..3).all(inside);
    let zero = match stored {
        true => DVec3::from(origin.map(|n| n as f64 - 1.0)),
        false => DVec3::from(size.map(|n| 0.5 * (n as f64 - 1.0))),
    };
    notes.push(format!(
        "Analyze 7.5 does not state the position of a volume: the first index is taken to run to \
        the left{}, and {} lies at the origin",
        if matches!(orient, 2 | 5) {
            " (the third, in sagittal slices)"
        } else {
            ""
        },
        if stored {
            "the voxel that SPM's header names"
        } else {
            "the centre"
        }
    ));
    Ok(DAffine3::from_mat3_translation(linear, -(linear * zero)))
}
