//! Positions from elsewhere: another engine (here a formula) writes the node positions of every
//! frame, and Palpate renders the interior. No physics of Palpate is involved.
//!
//!     cargo run --release --example other_engine [-- FOLDER]

use glam::{DQuat, DVec3};
use palpate::generate;
use palpate::mesh::Location;
use palpate::prelude::*;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or("out/other_engine".into());
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::new()?;
    let mesh = generate::benchmark_cube(10, false)?;
    let field = mesh.field("scalar", Location::Node);
    let scalars = field.map(|f| f.values.clone()).unwrap_or_default();
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars)?;
    let (frame, positions) = (geometry.frame(), geometry.positions().clone());
    let mut raycaster = Raycaster::new(&gpu, geometry, &TransferFunction::preset("viridis")?)?;
    let middle = DVec3::splat(0.5);
    let camera = Camera::perspective(DVec3::new(2.2, 1.6, 2.6), middle, DVec3::Y, 35.0);
    for i in 0..5 {
        // Twisted about the y axis in proportion to the height.
        let twist =
            |p: DVec3| middle + DQuat::from_rotation_y(0.25 * f64::from(i) * p.y) * (p - middle);
        let moved: Vec<[f32; 4]> = mesh
            .nodes
            .iter()
            .map(|p| frame.to_local(twist(*p)).extend(1.0).to_array())
            .collect();
        gpu.write_array(&positions, &moved)?;
        let picture = raycaster.picture(&camera, [400, 400])?;
        picture.save(format!("{folder}/twist_{i}.png"))?;
    }
    println!("{folder}/twist_0.png to twist_4.png");
    Ok(())
}
