//! Iterations per second of a grid body against its number of particles, on the GPU, on the CPU,
//! and of the reference loops in float64 and float32: `cargo bench --bench grid -- [PARTICLES...]`.
//! Corresponds to table 1 of Mosegaard, Herborg & Sørensen (2005).

use glam::{DMat3, DVec3};
use palpate::gpu::Gpu;
use palpate::mesher::Domain;
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{CpuGrid, GridBody, Material, Precision, Simulator};
use std::time::Instant;

/// A ball of the size of a heart, in metres.
struct Ball;

impl Domain for Ball {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-0.05), DVec3::splat(0.05))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, 0.05 - p.length()));
    }
}

/// Calls `run` with a number of steps until half a second has passed; returns steps per second.
fn rate(mut run: impl FnMut(u32) -> palpate::Result<()>) -> palpate::Result<f64> {
    let mut steps = 8;
    loop {
        let start = Instant::now();
        run(steps)?;
        let seconds = start.elapsed().as_secs_f64();
        if seconds > 0.5 {
            return Ok(f64::from(steps) / seconds);
        }
        steps *= 2;
    }
}

fn main() -> palpate::Result<()> {
    let given: Vec<usize> = std::env::args().skip(1).flat_map(|a| a.parse()).collect();
    let counts = match given.as_slice() {
        [] => &[10_000, 20_000, 40_000, 50_000, 100_000],
        given => given,
    };
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter().name);
    println!("| particles | GPU | CPU | CPU / GPU | float64 loop | float32 loop |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for wanted in counts {
        let shape = GridShape::from_domain_with_count(&Ball, *wanted, DMat3::IDENTITY)?;
        let model = GridModel::new(shape, &Material::from_young(1e4))?;
        let (count, h) = (model.shape.count(), 0.5 * model.conservative_step());
        let mut double = model.reference();
        let mut single = double.to_f32();
        let mesh = model.shape.mesh(&model.springs)?;
        let mut cpu = CpuGrid::new(&gpu, model.clone(), mesh, Precision::Single)?;
        let mut body = GridBody::new(&gpu, model)?;
        // In turns, the best of each: the machine may have other load.
        let mut best = [0.0f64; 4];
        for _ in 0..3 {
            best[0] = best[0].max(rate(|steps| body.run(steps, h))?);
            best[3] = best[3].max(rate(|steps| cpu.run(steps, h).map(drop))?);
            best[1] = best[1].max(rate(|steps| {
                (0..steps).for_each(|_| double.step(h));
                Ok(())
            })?);
            best[2] = best[2].max(rate(|steps| {
                (0..steps).for_each(|_| single.step(h as f32));
                Ok(())
            })?);
        }
        let [gpu, double, single, cpu] = best;
        println!(
            "| {count} | {gpu:.1} | {cpu:.1} | {:.2} | {double:.1} | {single:.1} |",
            cpu / gpu
        );
    }
    Ok(())
}
