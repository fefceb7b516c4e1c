//! Makes the small meshes under `data/` (or in a folder given as the argument) anew.

use palpate::Result;
use palpate::io;
use palpate::mesh::generate::{Bore, ball, duct, limb, paper_bar};
use palpate::mesh::{TetMesh, Topology, depth_field};
use std::path::PathBuf;

/// The mesh with a field to colour it by.
fn with_depth(mut mesh: TetMesh) -> Result<TetMesh> {
    let depth = depth_field(&mesh, &Topology::new(&mesh));
    mesh.set_field(depth)?;
    Ok(mesh)
}

/// File names and meshes.
pub fn meshes() -> Result<Vec<(&'static str, TetMesh)>> {
    let size = glam::DVec3::splat(0.1);
    Ok(vec![
        ("bar.vtu", paper_bar()?),
        ("ball.vtu", with_depth(ball(0.05, 8)?)?),
        ("duct.vtu", with_depth(duct([9, 9, 6], size, Bore::Round)?)?),
        ("limb.vtu", limb(20_000)?),
    ])
}

fn main() -> Result<()> {
    let here = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or(here.into()));
    std::fs::create_dir_all(&folder).map_err(palpate::Error::io(&folder))?;
    for (name, mesh) in meshes()? {
        let path = folder.join(name);
        io::write(&path, &mesh)?;
        let (nodes, tets) = (mesh.nodes.len(), mesh.tets.len());
        println!("{}: {nodes} nodes, {tets} tets", path.display());
    }
    Ok(())
}
