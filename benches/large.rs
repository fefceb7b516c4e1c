//! Time from a large mesh to its first image, by phase, and peak memory: the benchmark cube of
//! about N tets, with lighting, 1024 x 1024 pixels.
//!
//!     cargo bench --bench large -- 10000000
//!
//! The peak memory is that of this process, which includes the textures of the software driver.

use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{LocalFrame, Location, Topology};
use palpate::render::*;
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    // `cargo bench` adds an argument.
    let word = std::env::args().skip(1).find(|a| a != "--bench");
    let tets = word.map_or(Ok(1_000_000), |word| word.parse())?;
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter_name());
    let begin = Instant::now();
    let mesh = timed("mesh", || generate::by_name("cube", Some(tets)))?;
    let topology = timed("neighbours", || Ok(Topology::new(&mesh)))?;
    let scalars = mesh
        .field("scalar", Location::Node)
        .map(|f| f.values.clone())
        .unwrap_or_default();
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(&gpu, &frame, &mesh.nodes)?;
    let mut geometry = timed("geometry", || {
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars)?;
        gpu.wait()?;
        Ok(geometry)
    })?;
    timed("lighting lists", || {
        geometry.enable_lighting(&mesh, &topology, &scalars)?;
        gpu.wait()
    })?;
    let options = RaycastOptions {
        light: Light::Head,
        ..Default::default()
    };
    let transfer = TransferFunction::preset("tissue")?;
    let mut caster = Raycaster::with_options(&gpu, geometry, &transfer, options)?;
    let middle = DVec3::splat(0.5);
    let camera = Camera::perspective(middle + DVec3::new(1.3, 0.8, 2.0), middle, DVec3::Y, 30.0);
    timed("first image", || caster.picture(&camera, [1024; 2]))?;
    let camera = camera.orbited(7.0);
    timed("next image", || caster.picture(&camera, [1024; 2]))?;
    println!(
        "{} tets, {} nodes: {:.1} s in total",
        mesh.tets.len(),
        mesh.nodes.len(),
        begin.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Runs a phase and prints its time and the peak memory so far.
fn timed<T>(what: &str, make: impl FnOnce() -> palpate::Result<T>) -> palpate::Result<T> {
    let begin = Instant::now();
    let made = make()?;
    let seconds = begin.elapsed().as_secs_f64();
    println!("{what:>16}: {seconds:6.2} s, {}", peak());
    Ok(made)
}

/// Returns the peak memory of this process, if the system reports it.
fn peak() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.map_or("unknown".into(), |l| format!("peak {}", l.trim()))
}
