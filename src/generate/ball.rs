//! Generator of balls.

use super::grid::{check_size, from_parts};
use super::lattice_fill::fill_solid;
use crate::mesh::TetMesh;
use crate::{Error, Result, no_progress};
use glam::DVec3;

/// Number of cells above which the tets cannot be indexed.
const MAX_CELLS: usize = 350;

/// Returns a ball of `radius` about the origin, of well-shaped tets, about `cells` lattice cells
/// across: 10 gives about 6,000 tets, and the number grows with the cube.
///
/// # Errors
/// An error if the radius is not positive and finite, or for fewer than 2 cells, or too many to
/// index.
pub fn ball(radius: f64, cells: usize) -> Result<TetMesh> {
    check_size("a ball", DVec3::splat(radius))?;
    if !(2..=MAX_CELLS).contains(&cells) {
        return Err(Error::Input(format!(
            "ball must be 2 to {MAX_CELLS} cells across, got {cells}"
        )));
    }
    let across = 0.5 * cells as f64;
    let centre = DVec3::splat(across);
    let filled = fill_solid(
        2.0 * centre,
        0.0,
        |p| across - p.distance(centre),
        &no_progress,
    )?;
    let place = |p: &DVec3| (*p - centre) * (radius / across);
    from_parts(filled.nodes.iter().map(place).collect(), filled.tets)
}
