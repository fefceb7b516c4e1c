//! A bar of tets is cut through while it is pulled, and the gap opens.
//!
//!     cargo run --release --example cut [-- OUT.png]

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, Topology, components, depth_field, generate};
use palpate::physics::{Body, ImplicitEuler, Material, Solver};
use palpate::render::{Camera, Geometry, Mode, Raycaster, TransferFunction};

fn main() -> palpate::Result<()> {
    let out = std::env::args().nth(1).unwrap_or("cut.png".into());
    let gpu = Gpu::new()?;
    let mut mesh = generate::bar([12, 6, 6], DVec3::new(0.12, 0.06, 0.06))?;
    let mut topology = Topology::new(&mesh);
    let mut body = Body::new(&gpu, &mesh, &Material::young(2e4))?;
    body.pin(|p| p.x < 0.001);
    body.add_force(DVec3::new(0.5, 0.0, 0.0), |p| p.x > 0.119)?;
    let mut solver = ImplicitEuler::new(&gpu, &body)?;
    solver.run(&mut body, 20, 0.005)?;

    let mut depth = depth_field(&mesh, &topology).values;
    let geometry = Geometry::following(&gpu, &mesh, body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.denser(8.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;

    // The edge of the blade moves down through the middle, a little askew.
    let edge = |z: f64| [DVec3::new(0.05, -0.1, z), DVec3::new(0.07, 0.2, z)];
    let blade = Blade::swept(&[edge(0.1), edge(-0.1)])?;
    let cut = body.cut(&mut mesh, &mut topology, &blade)?;
    // Doubled nodes take the values of those they come from; only what changed is sent.
    for [_, from] in &cut.doubled {
        depth.push(depth[*from as usize]);
    }
    let positions = body.nodes().array();
    let geometry = raycaster.geometry_mut();
    geometry.follow(&mesh, &topology, &cut, positions, &depth)?;
    let (doubled, pieces) = (cut.doubled.len(), components(&topology).1);
    println!("{doubled} nodes were doubled; there are {pieces} pieces");

    solver.run(&mut body, 30, 0.005)?;
    let middle = DVec3::new(0.08, 0.03, 0.03);
    let eye = middle + DVec3::new(0.1, -0.5, 0.2);
    let camera = Camera::perspective(eye, middle, DVec3::Z, 16.0);
    let picture = raycaster.image(&camera, [640, 400], Mode::Composite)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
