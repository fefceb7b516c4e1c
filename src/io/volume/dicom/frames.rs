//! Volumes in a single file: one slice, or a frame per slice.

use super::slice::{Image, Slice};
use super::stack;
use crate::io::cursor::ParseResult;
use crate::io::volume::voxels::chosen;
use crate::volume::Volume;
use glam::DVec3;
use std::collections::HashSet;
use std::path::PathBuf;

/// Largest distance between positions that are the same, mm.
const SAME: f64 = 1e-3;

/// Parses the volume in a file: number `number` of several with the same positions.
pub(in crate::io::volume) fn read_file(file: &[u8], number: Option<usize>) -> ParseResult<Volume> {
    let Some(image) = Image::parse(file)? else {
        return Err("the DICOM file contains no image (no `PixelData`)".into());
    };
    let mut volume = volume(&image, number)?;
    if volume.size[2] == 1 {
        volume.notes.push(
            "the file is one slice; if it belongs to a series, name its folder to read all slices"
                .into(),
        );
    }
    Ok(volume)
}

/// Returns the volume of the frames of an image.
pub(super) fn volume(image: &Image, number: Option<usize>) -> ParseResult<Volume> {
    let frames = image.frames()?;
    let pixels = image.pixel_data()?;
    let mut slices = Vec::new();
    for frame in 0..frames {
        slices.push(image.slice(&pixels, frame).map_err(|e| match frames {
            1 => e,
            _ => format!("frame {}: {e}", frame + 1),
        })?);
    }
    let mut notes = Vec::new();
    if frames > 1 && !image.places_frames() {
        notes.push(place(image, &mut slices)?);
    }
    let named = slices.into_iter().enumerate();
    let named = named.map(|(n, slice)| (PathBuf::from(format!("frame {}", n + 1)), slice));
    let slices = of_one_volume(named.collect(), number)?;
    let volume = stack(slices).map_err(|(frame, e)| match frames {
        1 => e,
        _ => format!("{}: {e}", frame.display()),
    })?;
    Ok(Volume { notes, ..volume })
}

/// Places frames that share one position along the normal, and says so.
fn place(image: &Image, slices: &mut [Slice]) -> ParseResult<String> {
    let offsets = image.offsets(slices.len())?.ok_or(
        "the frames have no positions; expected `GridFrameOffsetVector`, `SpacingBetweenSlices`, \
        `SliceThickness` or a position per frame",
    )?;
    let [along, down] = slices[0].axes;
    // A vector that does not begin at 0 has positions along the patient's axis.
    let direction = match offsets[0] == 0.0 {
        true => along.cross(down),
        false => DVec3::Z,
    };
    for (slice, offset) in slices.iter_mut().zip(&offsets) {
        slice.position += direction * (offset - offsets[0]);
    }
    Ok(format!(
        "the frames have no positions of their own; they were placed {:.4} mm apart",
        (offsets[1] - offsets[0]).abs()
    ))
}

/// Returns the slices of volume `number`, if several frames have each position (times, echoes).
fn of_one_volume(
    slices: Vec<(PathBuf, Slice)>,
    number: Option<usize>,
) -> ParseResult<Vec<(PathBuf, Slice)>> {
    let [along, down] = slices[0].1.axes;
    let normal = along.cross(down);
    let height = |n: &usize| slices[*n].1.position.dot(normal);
    let mut order: Vec<usize> = (0..slices.len()).collect();
    order.sort_by(|a, b| height(a).total_cmp(&height(b)));
    let same = |a: &usize, b: &usize| (height(b) - height(a)).abs() <= SAME;
    let mut places: Vec<Vec<usize>> = order.chunk_by(same).map(<[usize]>::to_vec).collect();
    let count = places[0].len();
    // Unequal numbers are an error of the positions, which `stack` explains.
    let count = match places.iter().all(|place| place.len() == count) {
        true => count,
        false => 1,
    };
    let what = "frames with the same position";
    let chosen = chosen(number, count, what)?;
    if count == 1 {
        return Ok(slices);
    }
    places.iter_mut().for_each(|place| place.sort_unstable());
    let kept: HashSet<usize> = places.iter().map(|place| place[chosen]).collect();
    let numbered = slices.into_iter().enumerate();
    let own = numbered.filter(|(n, _)| kept.contains(n));
    Ok(own.map(|(_, slice)| slice).collect())
}
