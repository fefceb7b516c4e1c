//! What a pixel shows is picked, grabbed and pulled towards the eye.
//!
//!     cargo run --release --example pick [-- OUT.png]

use glam::{DVec2, DVec3};
use palpate::gpu::Gpu;
use palpate::mesh::{Topology, depth_field, generate};
use palpate::physics::{Body, Grip, ImplicitEuler, Material, Solver};
use palpate::render::{Camera, Geometry, Mode, Raycaster, TransferFunction};

fn main() -> palpate::Result<()> {
    let out = std::env::args().nth(1).unwrap_or("pick.png".into());
    let gpu = Gpu::new()?;
    let mesh = generate::ball(0.1, 14)?;
    let mut body = Body::new(&gpu, &mesh, &Material::young(5e3))?;
    body.pin(|p| p.z < -0.07);
    let mut solver = ImplicitEuler::new(&gpu, &body)?;

    let topology = Topology::new(&mesh);
    let depth = depth_field(&mesh, &topology).values;
    let geometry = Geometry::following(&gpu, &mesh, body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.denser(20.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;
    let eye = DVec3::new(0.15, -0.45, 0.15);
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 34.0);
    let pixels = [480, 480];

    // The one read-back: where the button goes down.
    let clicked = DVec2::new(300.5, 180.5);
    let Some(pick) = raycaster.geometry().pick(&camera, clicked, pixels)? else {
        println!("there is nothing at {clicked}");
        return Ok(());
    };
    println!("{pick:?}");
    let hand = body.grab(pick.point, 0.025, Grip::Follow)?;

    // The hand follows the pointer at the distance at which it took hold.
    for n in 1..=20 {
        let pointer = clicked + DVec2::new(6.0, -4.0) * f64::from(n);
        let ray = camera.ray(pointer, pixels);
        body.set_target(hand, ray.origin + pick.distance * ray.direction)?;
        solver.run(&mut body, 2, 0.01)?;
    }
    let picture = raycaster.image(&camera, pixels, Mode::Composite)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
