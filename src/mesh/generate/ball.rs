//! A ball.

use super::grid::{check_size, from_parts};
use super::stuffing::stuff;
use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::DVec3;

/// A ball of `radius` about the origin, of well-shaped tets, about `cells` lattice cells across:
/// 10 gives some 6,000 tets, and the number grows with the cube.
///
/// # Errors
/// A radius that is not positive and finite, or fewer than 2 cells, or too many to index.
pub fn ball(radius: f64, cells: usize) -> Result<TetMesh> {
    check_size("a ball", DVec3::splat(radius))?;
    if !(2..100_000).contains(&cells) {
        return Err(Error::Input(format!(
            "a ball cannot be {cells} cells across; give a number from 2 up"
        )));
    }
    // A cell to spare on each side.
    let centre = 0.5 * cells as f64 + 1.0;
    let across = 0.5 * cells as f64;
    let filled = stuff([cells + 2; 3], |p| {
        across - p.distance(DVec3::splat(centre))
    })?;
    let place = |p: &DVec3| (*p - centre) * (radius / across);
    from_parts(filled.nodes.iter().map(place).collect(), filled.tets)
}
