//! A bar of tets is cut while it is stretched, and the gap opens.
//!
//!     cargo run --release --example cut [-- OUT.png]

use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Blade, components, depth_field};
use palpate::prelude::*;

fn main() -> palpate::Result<()> {
    let out = std::env::args().nth(1).unwrap_or("cut.png".into());
    let gpu = Gpu::new()?;
    let mesh = generate::bar([12, 6, 6], DVec3::new(0.12, 0.06, 0.06))?;
    let (engine, soft) = (EngineChoice::Auto, Material::from_young(2e4));
    let mut body = engine.build_tets(&gpu, mesh, &soft, SolverKind::Implicit)?;
    body.pin(|p| p.x < 0.001)?;
    body.add_force(DVec3::new(0.5, 0.0, 0.0), |p| p.x > 0.119)?;
    body.run(20, 0.005)?;

    let mut depth = depth_field(body.mesh(), body.topology()).values;
    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.scale_extinction(8.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;

    // The edge of the blade moves down through the centre, slightly oblique.
    let edge = |z: f64| [DVec3::new(0.05, -0.1, z), DVec3::new(0.07, 0.2, z)];
    let blade = Blade::from_sweep(&[edge(0.1), edge(-0.1)])?;
    let cut = body.cut(&blade)?.mesh;
    // Duplicated nodes get the values of their originals; only changes are uploaded.
    for [_, from] in &cut.duplicated_nodes {
        depth.push(depth[*from as usize]);
    }
    let (positions, geometry) = (body.nodes().array(), raycaster.geometry_mut());
    geometry.apply_cut(body.mesh(), body.topology(), &cut, positions, &depth)?;
    let (doubled, pieces) = (cut.duplicated_nodes.len(), components(body.topology()).1);
    println!("{doubled} nodes duplicated; {pieces} pieces");

    body.run(30, 0.005)?;
    body.sync_nodes()?;
    let middle = DVec3::new(0.08, 0.03, 0.03);
    let eye = middle + DVec3::new(0.1, -0.5, 0.2);
    let camera = Camera::perspective(eye, middle, DVec3::Z, 16.0);
    let picture = raycaster.picture(&camera, [640, 400])?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
