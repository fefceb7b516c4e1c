//! Regenerates the small meshes, volumes and surfaces under `data/` (or in a folder given as the
//! argument).

mod bars;
mod chest;
mod heart;
mod phantoms;

use palpate::Result;
use palpate::generate::{Bore, ball, duct, foot_bones, limb, paper_bar};
use palpate::io;
use palpate::mesh::{TetMesh, Topology, TriMesh, depth_field};
use palpate::volume::Volume;
use std::path::PathBuf;

/// Edge length of the bones of the foot, m: the finest for a file below 400 KB.
const FOOT_SPACING: f64 = 0.003;

/// Adds the depth field to a mesh, for colouring.
fn with_depth(mut mesh: TetMesh) -> Result<TetMesh> {
    let depth = depth_field(&mesh, &Topology::new(&mesh));
    mesh.set_field(depth)?;
    Ok(mesh)
}

/// Returns the file names and meshes.
pub fn meshes() -> Result<Vec<(&'static str, TetMesh)>> {
    let size = glam::DVec3::splat(0.1);
    Ok(vec![
        ("bar.vtu", paper_bar()?),
        ("ball.vtu", with_depth(ball(0.05, 8)?)?),
        ("duct.vtu", with_depth(duct([9, 9, 6], size, Bore::Round)?)?),
        ("limb.vtu", limb(20_000)?),
        ("limb_10k.vtu", limb(10_000)?),
        ("bars.vtu", bars::bodies()?),
    ])
}

/// Returns the file names and volumes.
pub fn volumes() -> Vec<(&'static str, Volume)> {
    vec![
        ("knee.nrrd", phantoms::knee()),
        ("head_ct.mha", phantoms::head_ct()),
        ("chest_ct.mha", chest::chest_ct()),
        ("head_mri.nii.gz", phantoms::head_mri()),
        ("heart.nrrd", heart::labels()),
    ]
}

/// Returns the file names and surfaces.
pub fn surfaces() -> Result<Vec<(&'static str, TriMesh)>> {
    Ok(vec![
        ("lobe.stl", phantoms::lobe()),
        ("heart.obj", heart::surface(64, 40, false)),
        ("bar_left.ply", bars::tube(0)),
        ("bar_right.ply", bars::tube(1)),
        ("foot_bones.ply", foot_bones(FOOT_SPACING)?),
    ])
}

fn main() -> Result<()> {
    let here = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or(here.into()));
    std::fs::create_dir_all(&folder).map_err(palpate::Error::io(&folder))?;
    for (name, mesh) in meshes()? {
        let path = folder.join(name);
        io::write(&path, &mesh)?;
        let (nodes, tets) = (mesh.nodes.len(), mesh.tets.len());
        println!("{}: {nodes} nodes, {tets} tets", path.display());
    }
    for (name, volume) in volumes() {
        let path = folder.join(name);
        io::write_volume(&path, &volume)?;
        println!("{}: {:?} voxels", path.display(), volume.size);
    }
    heart::normals()?.save(folder.join("heart_normals.png"))?;
    for (name, surface) in surfaces()? {
        let path = folder.join(name);
        io::write_surface(&path, &surface)?;
        println!("{}: {} triangles", path.display(), surface.triangles.len());
    }
    Ok(())
}
