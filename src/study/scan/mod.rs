//! `study scan`: images of a scan embedded in coarse cages, against meshes with its values at their
//! nodes: error against time, and the number of tets for equal sharpness.

mod finding;
mod phantom;
mod subject;

use super::pictures::frame_ms;
use super::scaling::taken;
use super::{Cell, Run};
use crate::Result;
use crate::generate;
use crate::mesh::TetMesh;
use crate::render::{Image, ImageDifference, Mode, RaycastOptions, Raycaster};
use std::path::Path;

pub(crate) use subject::{BALL, ScanRepresentation, Subject};

/// Kinds of points.
const KINDS: [(&str, ScanRepresentation); 3] = [
    ("cage", ScanRepresentation::Scan),
    ("means", ScanRepresentation::Means),
    ("samples", ScanRepresentation::Samples),
];

const SETTINGS: [&str; 4] = ["what", "cells", "voxels", "pixels"];
/// `share` is the frame time over that of the reference cage, measured in alternating frames.
const RESULTS: [&str; 9] = [
    "nodes",
    "tets",
    "rmse_255",
    "flip",
    "gradient_r2",
    "ms",
    "reference_ms",
    "share",
    "gpu_mb",
];

/// Sizes to measure: voxels and pixels along a side, and balls by their cells across.
struct Sizes {
    voxels: usize,
    pixels: usize,
    cages: &'static [usize],
    values: &'static [usize],
    /// The cage whose relative time is 1.
    reference: usize,
    /// Meshes of samples whose images are saved.
    kept: [usize; 2],
    /// Number of timed pairs of frames.
    pairs: usize,
}

const FULL: Sizes = Sizes {
    voxels: 224,
    pixels: 320,
    cages: &[5, 8, 12, 20],
    values: &[6, 8, 12, 18, 26, 38, 55, 80, 118, 136],
    reference: 12,
    kept: [26, 136],
    pairs: 5,
};
const QUICK: Sizes = Sizes {
    voxels: 64,
    pixels: 96,
    cages: &[6, 10],
    values: &[4, 8, 16],
    reference: 10,
    kept: [8, 16],
    pairs: 3,
};

/// A mesh and its raycaster.
struct MeshRenderer {
    mesh: TetMesh,
    caster: Raycaster,
    bytes: f64,
}

/// Data that every point is compared with.
struct ReferenceScene {
    subject: Subject,
    truth: Image,
    reference: MeshRenderer,
}

/// Measures, draws charts and reports.
///
/// # Errors
/// An error if a file cannot be written, or the device fails.
pub(super) fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if scene.is_some() {
        run.report_note("ignoring the scene: the scan study uses a bent ball");
    }
    let sizes = if run.quick { &QUICK } else { &FULL };
    let mut points: Vec<Vec<Cell>> = Vec::new();
    for (what, knows) in KINDS {
        let balls = match knows {
            ScanRepresentation::Scan => sizes.cages,
            ScanRepresentation::Means | ScanRepresentation::Samples => sizes.values,
        };
        points.extend(balls.iter().map(|cells| {
            let numbers = [*cells, sizes.voxels, sizes.pixels].map(Cell::from);
            [Cell::from(what)].into_iter().chain(numbers).collect()
        }));
    }
    let mut prepared: Option<ReferenceScene> = None;
    let rows = run.measure("scan", &SETTINGS, &RESULTS, &points, |point| {
        let prepared = match &mut prepared {
            Some(prepared) => prepared,
            None => prepared.insert(prepare(run, sizes)?),
        };
        measure(run, sizes, prepared, point)
    })?;
    finding::tell(run, sizes, &rows)
}

fn prepare(run: &Run, sizes: &Sizes) -> Result<ReferenceScene> {
    let subject = Subject::new(sizes.voxels, sizes.pixels)?;
    let truth = subject.truth();
    truth.save(run.dir.join("scan-truth.png"))?;
    Ok(ReferenceScene {
        reference: drawn(run, &subject, sizes.reference, ScanRepresentation::Scan)?,
        subject,
        truth,
    })
}

fn drawn(
    run: &Run,
    subject: &Subject,
    cells: usize,
    knows: ScanRepresentation,
) -> Result<MeshRenderer> {
    let mesh = generate::ball(BALL, cells)?;
    let options = RaycastOptions::default();
    let make = || subject.raycaster(run.gpu, &mesh, knows, options);
    let ((caster, notes), arrays, _) = taken(run.gpu, make)?;
    notes.iter().for_each(|note| run.report_note(note));
    let of_scan = match knows {
        ScanRepresentation::Scan => subject.scan_bytes(),
        ScanRepresentation::Means | ScanRepresentation::Samples => 0.0,
    };
    Ok(MeshRenderer {
        mesh,
        caster,
        bytes: arrays + of_scan,
    })
}

/// Renders a point, compares it with the reference image, and times it in alternation with the
/// reference.
fn measure(
    run: &Run,
    sizes: &Sizes,
    prepared: &mut ReferenceScene,
    point: &[Cell],
) -> Result<Vec<Cell>> {
    let (what, cells) = (point[0].text(), point[1].number() as usize);
    let Some((_, knows)) = KINDS.into_iter().find(|(name, _)| *name == what) else {
        return Ok(Vec::new());
    };
    let subject = &prepared.subject;
    let mut own = drawn(run, subject, cells, knows)?;
    let (camera, size) = (&subject.camera, subject.size);
    let picture = own.caster.image(camera, size, Mode::Composite)?;
    let kept = match knows {
        ScanRepresentation::Scan => cells == sizes.reference,
        ScanRepresentation::Means => false,
        ScanRepresentation::Samples => sizes.kept.contains(&cells),
    };
    if kept {
        picture.save(run.dir.join(format!("scan-{what}-{cells}.png")))?;
    }
    let apart = ImageDifference::between(&prepared.truth, &picture)?;
    // Other load on the machine affects both frames of a pair.
    let mut times: [Vec<f64>; 3] = Default::default();
    for _ in 0..sizes.pairs {
        let reference = &mut prepared.reference.caster;
        let reference = frame_ms(run.gpu, reference, camera, size, 1)?;
        let own = frame_ms(run.gpu, &mut own.caster, camera, size, 1)?;
        for (times, time) in times.iter_mut().zip([own, reference, own / reference]) {
            times.push(time);
        }
    }
    let [ms, reference_ms, share] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    Ok(vec![
        own.mesh.nodes.len().into(),
        own.mesh.tets.len().into(),
        (255.0 * apart.rmse).into(),
        apart.flip.unwrap_or(f64::NAN).into(),
        gradient_r2(&prepared.truth, &picture).into(),
        ms.into(),
        reference_ms.into(),
        share.into(),
        (1e-6 * own.bytes).into(),
    ])
}

/// Returns the coefficient of determination of an image's pixel-to-pixel gradients against the
/// reference image: 1 for identical edges, 0 if the error is as large as the signal.
fn gradient_r2(truth: &Image, picture: &Image) -> f64 {
    let [width, height] = truth.size;
    let (mut off, mut whole) = (0.0, 0.0);
    for y in 1..height {
        for x in 1..width {
            for [u, v] in [[x - 1, y], [x, y - 1]] {
                let slope = |image: &Image, c: usize| {
                    f64::from(image.pixel(x, y)[c] - image.pixel(u, v)[c])
                };
                for c in 0..3 {
                    let own = slope(truth, c);
                    off += (slope(picture, c) - own).powi(2);
                    whole += own * own;
                }
            }
        }
    }
    1.0 - off / whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_r2_is_one_or_zero_at_extremes() {
        let of = |value: fn(f32) -> f32| Image {
            size: [16, 4],
            channels: 3,
            values: (0..16 * 4 * 3)
                .map(|n| value((n / 3 % 16) as f32))
                .collect(),
        };
        let waves = of(|x| 0.5 + 0.3 * x.sin());
        assert_eq!(gradient_r2(&waves, &waves), 1.0);
        assert_eq!(gradient_r2(&waves, &of(|_| 0.5)), 0.0);
        let halved = gradient_r2(&waves, &of(|x| 0.5 + 0.15 * x.sin()));
        assert!((halved - 0.75).abs() < 1e-5, "{halved}");
    }
}
