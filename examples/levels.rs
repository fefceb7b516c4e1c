//! One skin on a coarse and on a fine body: the fine one takes over during the motion.
//!
//!     cargo run --release --example levels [-- OUT.png]

use glam::DVec3;
use palpate::mesh::BarycentricMap;
use palpate::physics::Simulator;
use palpate::prelude::*;
use palpate::skin::{Skin, SkinBase};

fn main() -> palpate::Result<()> {
    let out = std::env::args().nth(1).unwrap_or("levels.png".into());
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/data/lobe.stl");
    let surface = palpate::io::read_surface(file)?;
    let gpu = Gpu::new()?;
    let [mut far, mut near] = [body(&gpu, file, 600)?, body(&gpu, file, 6_000)?];
    let mut skin = Skin::for_body(&gpu, &surface, far.as_ref())?;
    let level = skin.add_level(&SkinBase::from_body(&gpu, near.as_ref())?)?;

    far.run(15, 0.01)?;
    far.sync_nodes()?;
    let before = skin.vertices()?;

    // A nearby object needs a finer body: it continues from the state of the coarse one.
    let over = BarycentricMap::new(far.mesh(), &near.mesh().nodes)?;
    near.set_positions(&over.apply(&far.positions()?)?)?;
    near.set_velocities(&over.apply(&far.velocities()?)?)?;
    near.sync_nodes()?;
    skin.set_level(level)?;
    let jump = before.iter().zip(skin.vertices()?);
    let jump = jump.map(|(p, q)| p.distance(q)).fold(0.0, f64::max);
    println!("the skin jumps by {jump:.2} mm at the switch to the finer body");

    near.run(15, 0.01)?;
    near.sync_nodes()?;
    let camera = Camera::fit_mesh(near.mesh());
    skin.image(&camera, [480, 480])?.save(&out)?;
    println!("{out}");
    Ok(())
}

/// Creates a body of about `tets` tets at the position of the surface, hanging to one side.
fn body(gpu: &Gpu, file: &str, tets: usize) -> palpate::Result<Box<dyn Simulator>> {
    let mesh = palpate::meshing::mesh_file(file, tets)?;
    let mut material = Material::from_young(2e4);
    material.length_unit = 1e-3;
    let (low, high) = mesh.bounds();
    let engine = EngineChoice::Auto;
    let mut body = engine.build_tets(gpu, mesh, &material, SolverKind::Implicit)?;
    body.pin(|p| p.z < low.z + 0.1 * (high.z - low.z))?;
    let weight = DVec3::X * 9.81;
    body.loads_mut().set_gravity(weight);
    Ok(body)
}
