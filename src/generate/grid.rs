//! Generator of boxes: regular grids of hexahedral cells, each split into conforming tets.

use crate::mesh::{TetMesh, signed_volume};
use crate::{Error, Result};
use glam::DVec3;

/// Subdivision of a grid cell into tets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// One regular tet in the centre and four at the corners, mirrored in alternate cells.
    Five,
    /// Kuhn's subdivision into six tets around the diagonal from the lowest to the highest corner.
    Six,
}

/// The five tets of an even cell; corner = x + 2y + 4z. An odd cell has x mirrored.
pub(crate) const FIVE: [[usize; 4]; 5] = [
    [0, 3, 5, 6],
    [1, 0, 3, 5],
    [2, 0, 3, 6],
    [4, 0, 5, 6],
    [7, 3, 5, 6],
];

/// Kuhn's six tets: from corner 0 to corner 7, along the axes in each order.
const SIX: [[usize; 4]; 6] = [
    [0, 1, 3, 7],
    [0, 1, 5, 7],
    [0, 2, 3, 7],
    [0, 2, 6, 7],
    [0, 4, 5, 7],
    [0, 4, 6, 7],
];

/// Returns a box of `cells` grid cells with one corner at the origin and the opposite one at
/// `size`.
///
/// # Errors
/// An error for no cells along an axis, a size that is not positive and finite, or more nodes or
/// tets than 32-bit indices can address.
pub fn box_mesh(cells: [usize; 3], size: DVec3, split: Split) -> Result<TetMesh> {
    check_size("a box", size)?;
    let Grid { nodes, tets } = grid(cells, split, |_| true)?;
    let step = size / DVec3::from(cells.map(|n| n as f64));
    let place = |n: &[usize; 3]| DVec3::from(n.map(|i| i as f64)) * step;
    from_parts(nodes.iter().map(place).collect(), tets)
}

/// The lattice points used as nodes, and the tets between them.
pub(crate) struct Grid {
    pub nodes: Vec<[usize; 3]>,
    pub tets: Vec<[u32; 4]>,
}

/// Returns the nodes and tets of the grid cells that `keep` accepts, x running fastest.
pub(crate) fn grid(
    cells: [usize; 3],
    split: Split,
    keep: impl Fn([usize; 3]) -> bool,
) -> Result<Grid> {
    let nodes_along = cells.map(|n| n.saturating_add(1));
    let product = |n: [usize; 3]| n[0].checked_mul(n[1])?.checked_mul(n[2]);
    // Six tets per cell, and a quarter of the 32-bit range as TetMesh allows.
    let fits = product(nodes_along).is_some_and(|n| n <= u32::MAX as usize / 24);
    if product(cells).unwrap_or(1) == 0 || !fits {
        return Err(Error::Input(format!(
            "invalid grid of {} × {} × {} cells: each number must be ≥ 1, and the grid must have \
            at most {} nodes",
            cells[0],
            cells[1],
            cells[2],
            u32::MAX / 24
        )));
    }
    let mut used = vec![false; product(nodes_along).unwrap_or(0)];
    let index = |n: [usize; 3]| (n[0] + nodes_along[0] * (n[1] + nodes_along[1] * n[2])) as u32;
    let mut tets = Vec::new();
    for cell in lattice(cells).filter(|c| keep(*c)) {
        let mirror = usize::from(split == Split::Five && cell.iter().sum::<usize>() % 2 == 1);
        let corner = |c: usize| {
            let c = c ^ mirror;
            [
                cell[0] + (c & 1),
                cell[1] + (c >> 1 & 1),
                cell[2] + (c >> 2),
            ]
        };
        let pattern: &[[usize; 4]] = match split {
            Split::Five => &FIVE,
            Split::Six => &SIX,
        };
        for local in pattern {
            let corners = local.map(corner);
            let mut tet = corners.map(index);
            if signed_volume(corners.map(|n| DVec3::from(n.map(|i| i as f64)))) < 0.0 {
                tet.swap(1, 2);
            }
            for v in tet {
                used[v as usize] = true;
            }
            tets.push(tet);
        }
    }
    let mut new_index = vec![0u32; used.len()];
    let mut nodes = Vec::new();
    for (v, node) in lattice(nodes_along).enumerate().filter(|(v, _)| used[*v]) {
        new_index[v] = nodes.len() as u32;
        nodes.push(node);
    }
    for v in tets.iter_mut().flatten() {
        *v = new_index[*v as usize];
    }
    Ok(Grid { nodes, tets })
}

/// Iterates over all index triples below `n`, x running fastest.
fn lattice(n: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..n[2]).flat_map(move |k| (0..n[1]).flat_map(move |j| (0..n[0]).map(move |i| [i, j, k])))
}

/// Builds a mesh without fields.
pub(super) fn from_parts(nodes: Vec<DVec3>, tets: Vec<[u32; 4]>) -> Result<TetMesh> {
    TetMesh::new(nodes, tets, Vec::new(), Vec::new())
}

/// Rejects sizes that are not positive and finite.
pub(super) fn check_size(what: &str, size: DVec3) -> Result<()> {
    if size.is_finite() && size.min_element() > 0.0 {
        return Ok(());
    }
    Err(Error::Input(format!(
        "size of {what} must be positive and finite along each axis, got {size}"
    )))
}
