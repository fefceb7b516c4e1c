//! Cost of a cut: a thousand opened faces, in meshes of increasing size.
//!
//! `cargo bench --bench cut` prints milliseconds by mesh, each the median of seven adjacent cuts.

use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, Topology, cut};
use palpate::physics::{GpuBody, ImplicitEuler, Material, Solver};
use palpate::render::{Camera, Geometry, Mode, Raycaster, TransferFunction};
use std::time::Instant;

fn main() -> palpate::Result<()> {
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter().name);
    println!("    tets faces | read find springs  geometry    total | next step, image");
    for cells in [12, 20, 32, 44] {
        let mut mesh = generate::bar([cells; 3], DVec3::ONE)?;
        let mut topology = Topology::new(&mesh);
        let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(20_000.0))?;
        let mut solver = ImplicitEuler::new(&gpu, &body)?;
        let (positions, frame) = (body.nodes().array(), body.nodes().frame());
        let scalars = vec![0.5; mesh.nodes.len()];
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, positions, &scalars)?;
        let preset = TransferFunction::preset("tissue")?;
        let mut caster = Raycaster::new(&gpu, geometry, &preset)?;
        let camera = Camera::fit_mesh(&mesh);
        // Two faces per cell: a square of 22 cells, or the cross-section of the mesh.
        let half = 0.5 * (22.4 / cells as f64).min(1.5);
        let mut taken: [Vec<f64>; 7] = Default::default();
        let mut faces = 0;
        for k in 0..8 {
            let x = (f64::from(k) + 0.7) / 8.4;
            let corner = |y: f64, z: f64| DVec3::new(x, 0.5 + half * y, 0.5 + half * z);
            let blade = Blade::from_sweep(&[
                [corner(-1.0, -1.0), corner(1.0, -1.0)],
                [corner(-1.0, 1.0), corner(1.0, 1.0)],
            ])?;
            gpu.wait()?;
            let mut clock = vec![Instant::now()];
            let positions = body.positions()?;
            clock.push(Instant::now());
            let done = cut(&mut mesh, &mut topology, &positions, &blade)?;
            clock.push(Instant::now());
            body.apply_cut(&mesh, &done)?;
            clock.push(Instant::now());
            let scalars = vec![0.5; mesh.nodes.len()];
            let nodes = body.nodes().array();
            let geometry = caster.geometry_mut();
            geometry.apply_cut(&mesh, &topology, &done, nodes, &scalars)?;
            gpu.wait()?;
            clock.push(Instant::now());
            solver.step(&mut body, 0.001)?;
            gpu.wait()?;
            clock.push(Instant::now());
            caster.image(&camera, [256, 256], Mode::Composite)?;
            clock.push(Instant::now());
            let ms = |a: usize, b: usize| (clock[b] - clock[a]).as_secs_f64() * 1e3;
            let spans = [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4), (4, 5), (5, 6)];
            // The first cut creates pipelines.
            for (list, (a, b)) in taken.iter_mut().zip(spans).filter(|_| k > 0) {
                list.push(ms(a, b));
            }
            faces = done.opened_faces.len();
        }
        let median = |list: &mut Vec<f64>| {
            list.sort_by(f64::total_cmp);
            list.get(list.len() / 2).copied().unwrap_or(0.0)
        };
        let [read, find, springs, picture, all, step, image] = taken.each_mut().map(median);
        println!(
            "{:8} {faces:5} | {read:4.1} {find:4.1} {springs:7.1} {picture:9.1} {all:8.1} | {step:9.1} {image:7.1}",
            mesh.tets.len(),
        );
    }
    Ok(())
}
