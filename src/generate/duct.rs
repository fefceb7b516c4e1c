//! Generator of boxes with a duct: the simplest mesh that a ray enters twice.

use super::Split;
use super::grid::{Grid, check_size, from_parts, grid};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::DVec3;

/// The cross-section of a duct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bore {
    /// A rectangle with the box's proportions.
    Square,
    /// An ellipse with the box's proportions: round in a square box.
    Round,
}

/// Returns a box from the origin to `size` with a duct along z, a third as wide as the box.
///
/// `cells` counts the cells along each side of the box; the first two must be multiples of 3.
/// The boundary is a torus: its Euler number is 0.
///
/// # Errors
/// An error for an invalid number of cells, or a size that is not positive and finite.
pub fn duct(cells: [usize; 3], size: DVec3, bore: Bore) -> Result<TetMesh> {
    check_size("a duct", size)?;
    let [nx, ny, nz] = cells;
    if nx % 3 != 0 || ny % 3 != 0 {
        return Err(Error::Input(format!(
            "invalid duct of {nx} × {ny} × {nz} cells: the first two numbers must be multiples of \
            3, because the bore is the middle third"
        )));
    }
    match bore {
        Bore::Square => {
            let in_bore = |c: [usize; 3]| c[0] / (nx / 3) == 1 && c[1] / (ny / 3) == 1;
            let lattice = grid(cells, Split::Six, |c| !in_bore(c))?;
            let step = size / DVec3::from(cells.map(|n| n as f64));
            let place = |n: &[usize; 3]| DVec3::from(n.map(|i| i as f64)) * step;
            from_parts(lattice.nodes.iter().map(place).collect(), lattice.tets)
        }
        Bore::Round => round(cells, size),
    }
}

/// Meshes rings of cells from the bore to the sides of the box.
fn round([nx, ny, nz]: [usize; 3], size: DVec3) -> Result<TetMesh> {
    let around = (nx.saturating_add(ny)).saturating_mul(2);
    let rings = nx.min(ny) / 3;
    let Grid {
        nodes: lattice,
        mut tets,
    } = grid([around, rings, nz], Split::Six, |_| true)?;
    // The seam: the last lattice column coincides with the first.
    let row = around as u32 + 1;
    for v in tets.iter_mut().flatten() {
        let (line, i) = (*v / row, *v % row);
        *v = line * around as u32 + i % around as u32;
    }
    let place = |n: &[usize; 3]| {
        let side = perimeter(n[0], nx, ny);
        let bore = side.normalize_or_zero() / 3.0;
        let out = n[1] as f64 / rings as f64;
        let p = bore.lerp(side, out);
        DVec3::new(
            (0.5 + 0.5 * p.x) * size.x,
            (0.5 + 0.5 * p.y) * size.y,
            n[2] as f64 / nz as f64 * size.z,
        )
    };
    let nodes = lattice
        .iter()
        .filter(|n| n[0] < around)
        .map(place)
        .collect();
    from_parts(nodes, tets)
}

/// Returns point `i` on the boundary of the square [−1, 1]², clockwise from (−1, −1), so that
/// (around, out, z) is a right-handed system; z is 0.
fn perimeter(i: usize, nx: usize, ny: usize) -> DVec3 {
    let along = |i: usize, n: usize| 2.0 * i as f64 / n as f64 - 1.0;
    match i {
        _ if i < ny => DVec3::new(-1.0, along(i, ny), 0.0),
        _ if i < ny + nx => DVec3::new(along(i - ny, nx), 1.0, 0.0),
        _ if i < 2 * ny + nx => DVec3::new(1.0, -along(i - ny - nx, ny), 0.0),
        _ => DVec3::new(-along(i - 2 * ny - nx, nx), -1.0, 0.0),
    }
}
