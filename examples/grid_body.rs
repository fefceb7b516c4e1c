//! A grid body: carved out of a surface, clamped, grabbed, simulated, and rendered from inside.
//!
//!     cargo run --release --example grid_body [-- SURFACE.stl OUT.png]

use glam::DVec3;
use palpate::mesh::depth_field;
use palpate::mesher::SurfaceDomain;
use palpate::physics::GrabMode;
use palpate::physics::grid::GridModel;
use palpate::prelude::*;

fn main() -> palpate::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let file = arguments.next().unwrap_or(format!("{data}/lobe.stl"));
    let out = arguments.next().unwrap_or("grid_body.png".into());

    let gpu = Gpu::new()?;
    let inside = SurfaceDomain::read(&file)?;
    let mut material = Material::from_young(5e3);
    material.length_unit = 1e-3;
    let model = GridModel::from_domain(&inside, 5_000, &material)?;
    let mesh = model.shape.mesh(&model.springs)?;
    let mut body = EngineChoice::Auto.build_grid(&gpu, mesh, model)?;

    let (low, high) = body.mesh().bounds();
    let (size, middle) = (high - low, 0.5 * (low + high));
    let pinned = body.pin(|p| p.z < low.z + 0.1 * size.z)?;
    println!("{pinned} particles pinned");

    // The top follows a target that moves sideways.
    let top = middle.with_z(high.z);
    let hand = body.grab(top, 0.2 * size.z, GrabMode::Follow)?;
    let dt = 0.9 * body.largest_stable_step().unwrap_or(0.01);
    for n in 1..=40 {
        let away = DVec3::X * size.x * f64::from(n) / 80.0;
        body.set_target(hand, top + away)?;
        body.run(10, dt)?;
    }

    body.sync_nodes()?;
    let depth = depth_field(body.mesh(), body.topology()).values;
    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.scale_extinction(5.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;
    let pixels = [480, 480];
    let camera = Camera::fit_mesh_in(body.mesh(), pixels);
    let picture = raycaster.picture(&camera, pixels)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
