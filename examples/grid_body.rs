//! A grid body: carved out of a surface, held, grabbed, stepped, and seen from inside.
//!
//!     cargo run --release --example grid_body [-- SURFACE.stl OUT.png]

use glam::{DMat3, DVec3};
use palpate::gpu::Gpu;
use palpate::mesh::{Topology, depth_field};
use palpate::mesher::{ClosedSurface, SurfaceDomain};
use palpate::physics::grid::{GridBody, GridModel, GridShape};
use palpate::physics::{Grip, Material};
use palpate::render::{Camera, Geometry, Mode, Raycaster, TransferFunction};

fn main() -> palpate::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let file = arguments.next().unwrap_or(format!("{data}/lobe.stl"));
    let out = arguments.next().unwrap_or("grid_body.png".into());

    let gpu = Gpu::new()?;
    let surface = ClosedSurface::new(&palpate::io::read_surface(&file)?)?;
    let domain = SurfaceDomain::new(vec![surface])?;
    let shape = GridShape::carve_about(&domain, 5_000, DMat3::IDENTITY)?;
    let mut material = Material::young(5e3);
    material.length_unit = 1e-3;
    let mut body = GridBody::new(&gpu, GridModel::new(shape, &material)?)?;
    let mesh = body.mesh().clone();

    let (low, high) = mesh.bounds();
    let (size, middle) = (high - low, 0.5 * (low + high));
    let bottom = |i: &u32| mesh.nodes[*i as usize].z < low.z + 0.1 * size.z;
    let pinned: Vec<u32> = (0..mesh.nodes.len() as u32).filter(bottom).collect();
    body.pin_nodes(&pinned)?;
    println!("{} particles are pinned", pinned.len());

    // The top follows a hand that moves sideways.
    let top = middle.with_z(high.z);
    let hand = body.grab(top, 0.2 * size.z, Grip::Follow)?;
    let dt = 0.9 * body.model().stable_step();
    for n in 1..=40 {
        let away = DVec3::X * size.x * f64::from(n) / 80.0;
        body.set_target(hand, top + away)?;
        body.run(10, dt)?;
    }

    let topology = Topology::new(&mesh);
    let depth = depth_field(&mesh, &topology).values;
    let geometry = Geometry::following(&gpu, &mesh, body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.denser(5.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;
    let pixels = [480, 480];
    let camera = Camera::framing_for(&mesh, pixels);
    let picture = raycaster.image(&camera, pixels, Mode::Composite)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
