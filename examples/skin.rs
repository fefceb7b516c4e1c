//! A coarse body of tets under a detailed skin, pulled, and one picture of both.
//!
//!     cargo run --release --example skin [-- SURFACE.stl OUT.png]

use palpate::gpu::Gpu;
use palpate::mesh::depth_field;
use palpate::mesher::{Recipe, Size};
use palpate::physics::{EngineChoice, Grip, Material, SolverKind};
use palpate::render::{Camera, Geometry, Raycaster, TransferFunction};
use palpate::skin::{Carrier, ComposeOptions, Composer, Mapping, Skin};

fn main() -> palpate::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let file = arguments.next().unwrap_or(format!("{data}/lobe.stl"));
    let out = arguments.next().unwrap_or("skin.png".into());

    // The body: about 2,000 tets in the same place as the skin.
    let gpu = Gpu::new()?;
    let recipe = Recipe {
        input: vec![file.clone().into()],
        size: Some(Size::Tets(2_000)),
        ..Recipe::default()
    };
    let mesh = recipe.mesh(&|_, _| {})?.mesh;
    let mut material = Material::young(5e3);
    material.length_unit = 1e-3;
    let (low, high) = mesh.bounds();
    let (size, middle) = (high - low, 0.5 * (low + high));
    let engine = EngineChoice::Auto;
    let mut body = engine.tets(&gpu, mesh, &material, SolverKind::Implicit)?;
    body.pin(|p| p.z < low.z + 0.1 * size.z)?;

    // Bound once, where body and skin are at rest.
    let nodes = body.nodes();
    let carrier = Carrier::of_mesh(&gpu, body.mesh(), nodes.array(), nodes.frame())?;
    let surface = palpate::io::read_surface(&file)?;
    let mut skin = Skin::new(&gpu, &surface, &carrier, Mapping::Auto)?;
    println!("{:?}", skin.binding());
    skin.set_opacity(0.4)?;

    let top = middle.with_z(high.z);
    let hand = body.grab(top, 0.2 * size.z, Grip::Follow)?;
    body.set_target(hand, top + 0.3 * size.with_z(0.0))?;
    body.run(30, 0.02)?;
    body.publish_now()?;

    let depth = depth_field(body.mesh(), body.topology()).values;
    let geometry = Geometry::following(&gpu, body.mesh(), body.nodes(), &depth)?;
    let mut inside = Raycaster::new(&gpu, geometry, &TransferFunction::preset("viridis")?)?;
    let pixels = [480, 480];
    let camera = Camera::framing_for(body.mesh(), pixels);
    let mut composer = Composer::new(&gpu, ComposeOptions::default())?;
    let skins = std::slice::from_mut(&mut skin);
    let picture = composer.image(skins, Some(&mut inside), &camera, pixels)?;
    picture.save(&out)?;
    println!("{out}");
    Ok(())
}
