//! The point shown at a pixel is picked, grabbed and pulled towards the eye.
//!
//!     cargo run --release --example pick [-- OUT.png]

use glam::{DVec2, DVec3};
use palpate::generate;
use palpate::mesh::depth_field;
use palpate::physics::GrabMode;
use palpate::prelude::*;

fn main() -> palpate::Result<()> {
    let out = std::env::args().nth(1).unwrap_or("pick.png".into());
    let gpu = Gpu::new()?;
    let mesh = generate::ball(0.1, 14)?;
    let (engine, soft) = (EngineChoice::Auto, Material::from_young(5e3));
    let mut body = engine.build_tets(&gpu, mesh, &soft, SolverKind::Implicit)?;
    body.pin(|p| p.z < -0.07)?;

    let depth = depth_field(body.mesh(), body.topology()).values;
    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &depth)?;
    let transfer = TransferFunction::preset("viridis")?.scale_extinction(20.0);
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;
    let eye = DVec3::new(0.15, -0.45, 0.15);
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 34.0);
    let pixels = [480, 480];

    // The only read-back: when the button is pressed.
    let clicked = DVec2::new(300.5, 180.5);
    let Some(pick) = raycaster.geometry().pick(&camera, clicked, pixels)? else {
        println!("no body at pixel {clicked}");
        return Ok(());
    };
    println!("{pick:?}");
    let hand = body.grab(pick.point, 0.025, GrabMode::Follow)?;

    // The target follows the pointer at the distance of the pick.
    for n in 1..=20 {
        let pointer = clicked + DVec2::new(6.0, -4.0) * f64::from(n);
        let ray = camera.ray(pointer, pixels);
        body.set_target(hand, ray.origin + pick.distance * ray.direction)?;
        body.run(2, 0.01)?;
    }
    body.sync_nodes()?;
    let picture = raycaster.picture(&camera, pixels)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
