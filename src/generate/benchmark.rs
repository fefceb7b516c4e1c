//! The cube of the rendering benchmark: a mesh and a field that other raycasters render, too.

use super::Split;
use super::grid::{from_parts, grid};
use crate::Result;
use crate::mesh::{Field, Location, TetMesh};
use glam::DVec3;

/// Half the width of the duct of [`benchmark_cube`], measured between cell centres.
const HALF_BORE: f64 = 0.18;

/// Returns the unit cube in n³ cells of six tets (n = 20 gives 48,000, n = 40 gives 384,000), with
/// the node field `scalar` = ½ + ¼ (sin 9x cos 7y + sin(8z + 2x)) about the centre of the cube.
///
/// With `hole`, a square duct runs through it along z.
///
/// # Errors
/// As [`super::box_mesh`].
pub fn benchmark_cube(n: usize, hole: bool) -> Result<TetMesh> {
    let off_axis = |i: usize| ((i as f64 + 0.5) / n as f64 - 0.5).abs();
    let in_bore = |c: [usize; 3]| off_axis(c[0]) < HALF_BORE && off_axis(c[1]) < HALF_BORE;
    let lattice = grid([n; 3], Split::Six, |c| !(hole && in_bore(c)))?;
    let nodes: Vec<DVec3> = lattice
        .nodes
        .iter()
        .map(|p| DVec3::from(p.map(|i| i as f64 / n as f64)))
        .collect();
    let scalar = nodes
        .iter()
        .map(|p| *p - 0.5)
        .map(|u| {
            0.5 + 0.25 * ((9.0 * u.x).sin() * (7.0 * u.y).cos() + (8.0 * u.z + 2.0 * u.x).sin())
        })
        .collect();
    let mut mesh = from_parts(nodes, lattice.tets)?;
    mesh.set_field(Field::scalar("scalar", Location::Node, scalar))?;
    Ok(mesh)
}
