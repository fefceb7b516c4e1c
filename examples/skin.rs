//! A coarse body of tets under a detailed skin, bent by a load, and one picture of both.
//!
//!     cargo run --release --example skin [-- SURFACE.stl OUT.png]

use glam::DVec3;
use palpate::mesh::depth_field;
use palpate::prelude::*;
use palpate::skin::{Compositor, Skin};

fn main() -> palpate::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let file = arguments.next().unwrap_or(format!("{data}/lobe.stl"));
    let out = arguments.next().unwrap_or("skin.png".into());

    // The body: about 2,000 tets at the same position as the skin.
    let gpu = Gpu::new()?;
    let mesh = palpate::meshing::mesh_file(&file, 2_000)?;
    let mut material = Material::from_young(5e3);
    material.length_unit = 1e-3;
    let (low, high) = mesh.bounds();
    let engine = EngineChoice::Auto;
    let mut body = engine.build_tets(&gpu, mesh, &material, SolverKind::Implicit)?;
    body.pin(|p| p.z < low.z + 0.1 * (high.z - low.z))?;

    // Bound once, with body and skin at rest.
    let surface = palpate::io::read_surface(&file)?;
    let mut skin = Skin::for_body(&gpu, &surface, body.as_ref())?;
    println!("{:?}", skin.binding());
    skin.set_opacity(0.4)?;

    // Its weight bends it to one side.
    body.loads_mut().set_gravity(DVec3::new(6.0, 6.0, 0.0));
    body.run(30, 0.02)?;
    body.sync_nodes()?;

    let depth = depth_field(body.mesh(), body.topology()).values;
    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &depth)?;
    let mut inside = Raycaster::new(&gpu, geometry, &TransferFunction::preset("viridis")?)?;
    let pixels = [480, 480];
    let camera = Camera::fit_mesh_in(body.mesh(), pixels);
    let mut composer = Compositor::new(&gpu, Default::default())?;
    let skins = std::slice::from_mut(&mut skin);
    let picture = composer.image(skins, Some(&mut inside), &camera, pixels)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
