//! Steps a second of grid bodies: table 1 of Mosegaard, Herborg & Sørensen (2005).

use super::{Case, Context, Row};
use crate::Result;
use crate::mesher::Domain;
use crate::physics::grid::{GridModel, GridShape};
use crate::physics::{CpuGrid, GridBody, Material, Precision, Simulator};
use glam::{DMat3, DVec3};

pub(super) const ABOUT: &str = "A ball of the size of a heart, particles with springs to 18 \
    neighbours. The loops are plain parallel loops over the same springs, in float64 and float32. \
    The paper's values are those of a GPU and a CPU of 2005.";

/// Steps per submission.
const STEPS: u32 = 8;
const RADIUS: f64 = 0.05;
/// Particles, and the paper's iterations per second on the GPU and on the CPU.
const PAPER: [(usize, f64, f64); 5] = [
    (10_000, 839.8, 45.8),
    (20_000, 476.9, 20.2),
    (40_000, 264.6, 9.9),
    (50_000, 218.0, 7.8),
    (100_000, 104.1, 3.3),
];

/// A ball of the size of a heart, in metres.
pub(super) struct Ball;

impl Domain for Ball {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-RADIUS), DVec3::splat(RADIUS))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, RADIUS - p.length()));
    }
}

pub(super) fn model(particles: usize) -> Result<GridModel> {
    let shape = GridShape::from_domain_with_count(&Ball, particles, DMat3::IDENTITY)?;
    GridModel::new(shape, &Material::from_young(1e4))
}

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let sizes = if quick { &PAPER[..1] } else { &PAPER[..] };
    let mut all = Vec::new();
    for &(particles, on_gpu, on_cpu) in sizes {
        let kinds = [
            ("gpu", Some(on_gpu)),
            ("cpu", Some(on_cpu)),
            ("float64 loop", None),
            ("float32 loop", None),
        ];
        for (on, paper) in kinds {
            let row = Row::new("verlet", on, "steps/s")
                .size(particles, "particles")
                .paper(paper);
            all.push(Case::new(row, move |context, row| {
                rate(context, row, particles)
            }));
        }
    }
    all
}

fn rate(context: &Context, row: Row, particles: usize) -> Result<Row> {
    let (gpu, timing) = (context.gpu, context.timing());
    let model = model(particles)?;
    let (count, h) = (model.shape.count(), 0.5 * model.conservative_step());
    let spread = match row.on.as_str() {
        "gpu" => {
            let mut body = GridBody::new(gpu, model)?;
            timing.measure(|| body.run(STEPS, h))?
        }
        "cpu" => {
            let mesh = model.shape.mesh(&model.springs)?;
            let mut body = CpuGrid::new(gpu, model, mesh, Precision::Single)?;
            timing.measure(|| body.run(STEPS, h).map(drop))?
        }
        "float64 loop" => {
            let mut body = model.reference();
            timing.measure(|| {
                (0..STEPS).for_each(|_| body.step(h));
                Ok(())
            })?
        }
        _ => {
            let mut body = model.reference().to_f32();
            timing.measure(|| {
                (0..STEPS).for_each(|_| body.step(h as f32));
                Ok(())
            })?
        }
    };
    let row = row.size(count, "particles");
    Ok(row.spread(spread.per_second(f64::from(STEPS))))
}
