//! Reader for DICOM: a series of slices in a folder, with one slice per file, or a single file of one
//! or more frames.
//!
//! The format is described at dicomstandard.org; its world is LPS, in mm. The crate `dicom-object`
//! parses the files, after [`element_scan`] has checked their lengths.

mod element_scan;
mod frames;
mod slice;

pub(super) use frames::read_file;

use crate::parallel;
use crate::volume::{Raw, Volume};
use crate::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use slice::{Image, Slice};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Relative tolerance of the slice spacing.
const UNEVEN: f64 = 0.02;
/// Absolute tolerance of the slice spacing, mm, for the rounding of the stored positions.
const ROUNDING: f64 = 0.01;

/// Reads the series with the most images in `folder` (among equals, the one with the first
/// identifier). Other files are skipped.
pub(super) fn read(folder: &Path, number: Option<usize>) -> Result<Volume> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    let images = parallel::map_coarse(files.len(), |n| {
        let path = &files[n];
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        Image::parse(&bytes).map_err(|e| Error::format(path, e))
    });
    let images: Vec<Option<Image>> = images.into_iter().collect::<Result<_>>()?;
    let mut series: BTreeMap<String, Vec<(PathBuf, Image)>> = BTreeMap::new();
    for (path, image) in files.into_iter().zip(images) {
        if let Some(image) = image {
            let of_one = series.entry(image.series.clone()).or_default();
            of_one.push((path, image));
        }
    }
    // The last among equals is selected, so the order is reversed.
    let largest = series.into_values().rev().max_by_key(Vec::len);
    let largest = largest.ok_or_else(|| {
        Error::format(
            folder,
            "no file in this folder is a DICOM image (`DICM` at byte 128, with pixels)",
        )
    })?;
    if let [(path, image)] = largest.as_slice() {
        let volume = frames::volume(image, number);
        return volume.map_err(|e| Error::format(path, e));
    }
    if let Some(number) = number {
        return Err(Error::format(
            folder,
            format!("there is no volume {number}: a series of slices is one volume"),
        ));
    }
    for (path, image) in &largest {
        let frames = image.frames().map_err(|e| Error::format(path, e))?;
        if frames != 1 {
            return Err(Error::format(
                path,
                format!(
                    "has {frames} frames, and {} files of its series are in this folder; name the \
                    file alone",
                    largest.len()
                ),
            ));
        }
    }
    let slices: Vec<(PathBuf, Slice)> = largest
        .into_par_iter()
        .map(|(path, image)| {
            let slice = image.pixel_data().and_then(|data| image.slice(&data, 0));
            match slice {
                Ok(slice) => Ok((path, slice)),
                Err(e) => Err(Error::format(path, e)),
            }
        })
        .collect::<Result<_>>()?;
    stack(slices).map_err(|(path, e)| Error::format(path, e))
}

/// Whether a file contains a complete image.
pub(in crate::io) fn parse(file: &[u8]) -> std::result::Result<bool, String> {
    let image = Image::parse(file)?;
    image.map_or(Ok(false), |image| {
        frames::volume(&image, Some(0)).map(|_| true)
    })
}

/// Stacks `slices` to a volume; an error names its file.
fn stack(mut slices: Vec<(PathBuf, Slice)>) -> std::result::Result<Volume, (PathBuf, String)> {
    let first = &slices[0].1;
    let [along, down] = first.axes;
    let normal = along.cross(down);
    for (path, slice) in &slices {
        let turned = (0..2).any(|n| slice.axes[n].distance(first.axes[n]) > 1e-3);
        let what = if (slice.columns, slice.rows) != (first.columns, first.rows) {
            "`Rows` and `Columns`"
        } else if turned {
            "`ImageOrientationPatient`"
        } else if slice.spacing.distance(first.spacing) > 1e-3 * first.spacing.length() {
            "`PixelSpacing`"
        } else if slice.raw.scalar_type() != first.raw.scalar_type() {
            "`BitsAllocated` and `PixelRepresentation`"
        } else {
            continue;
        };
        let other = name(&slices[0].0);
        let what = format!("{what} must match {other}, a slice of the same series");
        return Err((path.clone(), what));
    }
    slices.sort_by(|(_, a), (_, b)| {
        let [a, b] = [a.position.dot(normal), b.position.dot(normal)];
        a.total_cmp(&b)
    });
    let step = step(&slices, normal)?;
    let first = &slices[0].1;
    let lps = DMat3::from_cols(along * first.spacing.x, down * first.spacing.y, step);
    let to_ras = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let size = [first.columns, first.rows, slices.len()];
    let to_world = DAffine3::from_mat3_translation(to_ras * lps, to_ras * first.position);
    let scaling = first.scaling;
    let same = slices.iter().all(|(_, s)| s.scaling == scaling);
    let [slope, intercept] = if same { scaling } else { [1.0, 0.0] };
    Ok(Volume {
        size,
        raw: match same {
            true => joined(slices),
            false => scaled(&slices),
        },
        slope,
        intercept,
        to_world,
        ..Volume::default()
    })
}

/// Returns the step between slices, which must be uniform.
fn step(
    slices: &[(PathBuf, Slice)],
    normal: DVec3,
) -> std::result::Result<DVec3, (PathBuf, String)> {
    let (path, only) = &slices[0];
    if slices.len() == 1 {
        let thickness = only.thickness.filter(|t| *t > 0.0 && t.is_finite());
        let what = "only slice of its series, but it has no `SliceThickness`";
        return Ok(normal * thickness.ok_or((path.clone(), what.into()))?);
    }
    let mut gaps: Vec<f64> = slices
        .windows(2)
        .map(|w| (w[1].1.position - w[0].1.position).dot(normal))
        .collect();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps[gaps.len() / 2];
    for pair in slices.windows(2) {
        let [(before, a), (path, b)] = pair else {
            continue;
        };
        let gap = (b.position - a.position).dot(normal);
        let before = name(before);
        let what = if gap <= ROUNDING {
            format!(
                "same position as {before} of the same series; several images at one position \
                (times, echoes) are not one volume"
            )
        } else if gap > 1.5 * usual {
            let missing = (gap / usual).round() - 1.0;
            format!(
                "{missing} slices are missing between {before} and this file: distance {gap:.3} \
                mm, expected {usual:.3} mm"
            )
        } else if (gap - usual).abs() > UNEVEN * usual + ROUNDING {
            format!(
                "slices must be evenly spaced: distance to {before} is {gap:.3} mm, expected \
                {usual:.3} mm"
            )
        } else {
            continue;
        };
        return Err((path.clone(), what));
    }
    let (_, last) = &slices[slices.len() - 1];
    let step = (last.position - only.position) / (slices.len() - 1) as f64;
    for (n, (path, slice)) in slices.iter().enumerate() {
        let expected = only.position + step * n as f64;
        let off = slice.position.distance(expected);
        if off > 0.1 * usual + ROUNDING {
            let what = format!(
                "slice positions must be collinear: {off:.3} mm off the line through the \
                    first and last slice"
            );
            return Err((path.clone(), what));
        }
    }
    Ok(step)
}

/// Concatenates the stored pixels of all slices.
fn joined(slices: Vec<(PathBuf, Slice)>) -> Raw {
    let mut raws = slices.into_iter().map(|(_, s)| s.raw);
    let mut all = raws.next().unwrap_or(Raw::U8(Vec::new()));
    for raw in raws {
        match (&mut all, raw) {
            (Raw::U8(all), Raw::U8(v)) => all.extend(v),
            (Raw::I8(all), Raw::I8(v)) => all.extend(v),
            (Raw::U16(all), Raw::U16(v)) => all.extend(v),
            (Raw::I16(all), Raw::I16(v)) => all.extend(v),
            (Raw::U32(all), Raw::U32(v)) => all.extend(v),
            (Raw::I32(all), Raw::I32(v)) => all.extend(v),
            // Slices of a series have the same type, as checked by `stack`.
            _ => {}
        }
    }
    all
}

/// Returns the values of slices with individual scalings, in single precision.
fn scaled(slices: &[(PathBuf, Slice)]) -> Raw {
    let values = slices.iter().flat_map(|(_, slice)| {
        let [slope, intercept] = slice.scaling;
        (0..slice.raw.len()).map(move |n| (slope * slice.raw.get(n) + intercept) as f32)
    });
    Raw::F32(values.collect())
}

fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
