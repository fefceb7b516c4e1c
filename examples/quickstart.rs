//! From a mesh file to a picture of its deformed interior.
//!
//!     cargo run --release --example quickstart [-- MESH.vtu OUT.png]

use palpate::mesh::Location;
use palpate::prelude::*;

fn main() -> palpate::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let file = arguments.next().unwrap_or(format!("{data}/limb.vtu"));
    let out = arguments.next().unwrap_or("quickstart.png".into());

    let gpu = Gpu::new()?;
    let mesh = palpate::io::read(&file)?;
    let field = mesh.field("intensity", Location::Node);
    let scalars = field.map_or(vec![0.0; mesh.nodes.len()], |f| f.values.clone());

    // On the GPU if there is one, otherwise on the CPU.
    let (engine, tissue) = (EngineChoice::Auto, Material::soft_tissue());
    let mut body = engine.build_tets(&gpu, mesh, &tissue, SolverKind::Implicit)?;
    println!("{}", body.clamp_one_end(2.0)?);
    body.run(30, 0.01)?;
    body.sync_nodes()?;

    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &scalars)?;
    let transfer = TransferFunction::read(format!("{data}/limb.json"))?;
    let mut raycaster = Raycaster::new(&gpu, geometry, &transfer)?;
    let size = [800, 600];
    let camera = Camera::fit_mesh_in(body.mesh(), size);
    raycaster.picture(&camera, size)?.save(&out)?;
    println!("{out}");
    Ok(())
}
