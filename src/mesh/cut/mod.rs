//! Cutting of a mesh: the faces nearest to a blade lose their link, and nodes are duplicated where
//! their tets then form several fans. Tets are neither subdivided nor removed.

mod faces;
mod fans;

use super::{
    Blade, BoundaryFace, ElementOrder, Location, NO_NEIGHBOUR, PIECES, TET_EDGES, TetMesh,
    Topology, replace_sorted,
};
use crate::{Error, Result};
use faces::{faces_crossing_blade, skip_isolated_tets};
use fans::{sorted_face, split_nodes};
use glam::DVec3;

/// Changes of a mesh by a cut or by the removal of tets.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetCut {
    /// Opened faces, each as seen from its two tets; both are boundary faces now. After a removal:
    /// the exposed faces, the second of each that of a removed tet, both in the old numbering.
    pub opened_faces: Vec<[BoundaryFace; 2]>,
    /// Each new node, and the node it duplicates. New nodes are last, in this order.
    pub duplicated_nodes: Vec<[u32; 2]>,
    /// Tets whose nodes or neighbours have changed, ascending.
    pub tets: Vec<u32>,
    /// Duplicated nodes and their duplicates, ascending.
    pub nodes: Vec<u32>,
    /// The tets at these nodes, ascending.
    pub incident_tets: Vec<u32>,
    /// The edges at these nodes before the cut, sorted.
    pub previous_edges: Vec<[u32; 2]>,
    /// The edges at these nodes now, each with every tet around it, sorted.
    pub edge_tets: Vec<([u32; 2], u32)>,
    /// Removed tets, ascending, in the old numbering; the remaining tets keep their order. After a
    /// removal, `tets`, `incident_tets` and the edges are not listed.
    pub removed: Vec<u32>,
}

impl TetCut {
    /// Whether nothing was cut and nothing has changed.
    pub fn is_empty(&self) -> bool {
        self.opened_faces.is_empty() && self.removed.is_empty()
    }
}

/// Cuts `mesh`, with its nodes at `positions`, along `blade`: opens every face whose two tets have
/// their centroids on different sides of the blade, and duplicates the nodes around which this
/// separates the tets. A blade right through a body thus leaves two components; where a cut ends
/// inside, its two sides stay joined at the nodes of its tip.
///
/// A face without a duplicated node cannot open and stays closed, and a single tet is not cut off
/// unless its neighbour is, too. Two consecutive sweeps open the same faces as one sweep along
/// both. Fields at nodes are copied to the duplicates. Nodes at which fans only touch before the
/// cut stay as they are. An error changes nothing.
///
/// # Errors
/// An [`Error::Input`] if `topology` or `positions` do not match `mesh`; an [`Error::Mesh`] if
/// there would be more nodes than can be indexed.
pub fn cut(
    mesh: &mut TetMesh,
    topology: &mut Topology,
    positions: &[DVec3],
    blade: &Blade,
) -> Result<TetCut> {
    cut_elements(mesh, topology, positions, blade, ElementOrder::Linear)
}

/// As [`cut`], for a mesh whose tets are the elements of a body of the given order or their pieces:
/// faces inside an element stay closed, and the others open by the centroids of the elements.
///
/// # Errors
/// As [`cut`], and an [`Error::Input`] if the tets are not pieces of elements of that order.
pub(crate) fn cut_elements(
    mesh: &mut TetMesh,
    topology: &mut Topology,
    positions: &[DVec3],
    blade: &Blade,
    order: ElementOrder,
) -> Result<TetCut> {
    check(mesh, topology)?;
    if positions.len() != mesh.nodes.len() {
        return Err(Error::Input(format!(
            "got {} positions for a mesh with {} nodes; give one position per node",
            positions.len(),
            mesh.nodes.len()
        )));
    }
    let mut faces = match order {
        ElementOrder::Linear => {
            let corners = |t: usize| mesh.tets[t];
            faces_crossing_blade(mesh, topology, positions, (blade, &corners))
        }
        ElementOrder::Quadratic => {
            let elements = mesh.ten_node_tets()?;
            let corners = |t: usize| {
                let [a, b, c, d, ..] = elements[t / PIECES];
                [a, b, c, d]
            };
            faces_crossing_blade(mesh, topology, positions, (blade, &corners))
        }
    };
    skip_isolated_tets(topology, &mut faces);
    for [a, b] in &faces {
        topology.neighbours[a.tet as usize][a.face as usize] = NO_NEIGHBOUR;
        topology.neighbours[b.tet as usize][b.face as usize] = NO_NEIGHBOUR;
    }
    let parted = split_nodes(mesh, topology, &faces, &[]);
    let (opened, closed): (Vec<_>, Vec<_>) = faces
        .into_iter()
        .partition(|[a, b]| sorted_face(mesh, *a) != sorted_face(mesh, *b));
    for [a, b] in closed {
        topology.neighbours[a.tet as usize][a.face as usize] = 4 * b.tet + b.face;
        topology.neighbours[b.tet as usize][b.face as usize] = 4 * a.tet + a.face;
    }
    let mut bare: Vec<BoundaryFace> = opened.iter().flatten().copied().collect();
    bare.sort_unstable();
    replace_sorted(&mut topology.boundary, |f| *f, &[], &bare);
    let mut tets: Vec<u32> = bare.iter().map(|f| f.tet).collect();
    let renamed = parted.star.iter().zip(&parted.before);
    tets.extend(
        renamed
            .filter(|(t, before)| mesh.tets[**t as usize] != **before)
            .map(|(t, _)| *t),
    );
    tets.sort_unstable();
    tets.dedup();
    let mut touched = vec![false; mesh.nodes.len()];
    for v in parted.duplicated.iter().flatten() {
        touched[*v as usize] = true;
    }
    let around = edges_around(mesh, &parted.star, &touched);
    let mut edges: Vec<[u32; 2]> = around.iter().map(|(edge, _)| *edge).collect();
    edges.dedup();
    let edges_before = edges_as_they_were(&edges, &parted.duplicated);
    let at_touched = |t: &u32| mesh.tets[*t as usize].iter().any(|v| touched[*v as usize]);
    let star = parted.star.into_iter().filter(at_touched).collect();
    Ok(TetCut {
        nodes: both(&parted.duplicated),
        incident_tets: star,
        opened_faces: opened,
        duplicated_nodes: parted.duplicated,
        tets,
        previous_edges: edges_before,
        edge_tets: around,
        removed: Vec::new(),
    })
}

/// Removes `tets` from `mesh`. Nodes around which several fans of tets remain are duplicated, so
/// parts that only touch at a node separate; nodes without tets stay in the list. The remaining
/// tets and fields of tets keep their order.
///
/// The time is proportional to the size of the mesh, unlike [`cut`].
///
/// # Errors
/// An [`Error::Input`] for tets that do not exist, for a `topology` that does not match `mesh`, and
/// if no tet would remain.
pub fn remove(mesh: &mut TetMesh, topology: &mut Topology, tets: &[u32]) -> Result<TetCut> {
    check(mesh, topology)?;
    let count = mesh.tets.len();
    if let Some(bad) = tets.iter().find(|t| **t as usize >= count) {
        return Err(Error::Input(format!(
            "cannot remove tet {bad}: index must be < {count} (counted from 0)"
        )));
    }
    let mut gone = vec![false; count];
    tets.iter().for_each(|t| gone[*t as usize] = true);
    let removed: Vec<u32> = (0..count as u32).filter(|t| gone[*t as usize]).collect();
    if removed.is_empty() {
        return Ok(TetCut::default());
    }
    if removed.len() == count {
        return Err(Error::Input(format!(
            "cannot remove all {count} tets; keep at least one"
        )));
    }
    let mut opened = Vec::new();
    for t in &removed {
        for face in 0..4 {
            let code = topology.neighbours[*t as usize][face];
            if code != NO_NEIGHBOUR && !gone[code as usize / 4] {
                topology.neighbours[*t as usize][face] = NO_NEIGHBOUR;
                topology.neighbours[code as usize / 4][code as usize % 4] = NO_NEIGHBOUR;
                let there = BoundaryFace {
                    tet: code / 4,
                    face: code % 4,
                };
                let here = BoundaryFace {
                    tet: *t,
                    face: face as u32,
                };
                opened.push([there, here]);
            }
        }
    }
    let parted = split_nodes(mesh, topology, &opened, &gone);
    let mut keep = gone.iter().map(|gone| !gone);
    mesh.tets.retain(|_| keep.next().unwrap_or(true));
    for field in &mut mesh.fields {
        if field.location == Location::Cell {
            let tuples = field.values.chunks_exact(field.components);
            let kept = tuples.zip(&gone).filter(|(_, gone)| !**gone);
            field.values = kept.flat_map(|(tuple, _)| tuple.to_vec()).collect();
        }
    }
    *topology = Topology::new(mesh);
    Ok(TetCut {
        opened_faces: opened,
        nodes: both(&parted.duplicated),
        duplicated_nodes: parted.duplicated,
        removed,
        ..TetCut::default()
    })
}

/// Returns the duplicated nodes and their duplicates, ascending.
fn both(doubled: &[[u32; 2]]) -> Vec<u32> {
    let mut nodes: Vec<u32> = doubled.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

fn check(mesh: &TetMesh, topology: &Topology) -> Result<()> {
    if topology.neighbours.len() != mesh.tets.len() {
        return Err(Error::Input(format!(
            "topology has {} tets but the mesh has {}; give the topology of this mesh",
            topology.neighbours.len(),
            mesh.tets.len()
        )));
    }
    // Up to that many duplicates may be needed.
    if mesh.nodes.len() + 4 * mesh.tets.len() > u32::MAX as usize {
        return Err(Error::Mesh(
            "duplicated nodes exceed the range of 32-bit indices; use a coarser mesh".into(),
        ));
    }
    Ok(())
}

/// Returns the edges of `tets` with at least one node in `touched`, each with its tets, sorted.
fn edges_around(mesh: &TetMesh, tets: &[u32], touched: &[bool]) -> Vec<([u32; 2], u32)> {
    // Packed into single integers, which sort faster than pairs.
    let mut packed = Vec::with_capacity(6 * tets.len());
    for t in tets {
        let tet = mesh.tets[*t as usize];
        for [a, b] in TET_EDGES.map(|edge| edge.map(|i| tet[i])) {
            if touched[a as usize] || touched[b as usize] {
                let (low, high) = (u128::from(a.min(b)), u128::from(a.max(b)));
                packed.push(low << 64 | high << 32 | u128::from(*t));
            }
        }
    }
    packed.sort_unstable();
    let unpack = |p: u128| ([(p >> 64) as u32, (p >> 32) as u32], p as u32);
    packed.into_iter().map(unpack).collect()
}

/// Returns the sorted `edges` as they were before nodes were duplicated, sorted.
fn edges_as_they_were(edges: &[[u32; 2]], doubled: &[[u32; 2]]) -> Vec<[u32; 2]> {
    let first = doubled.first().map_or(u32::MAX, |[new, _]| *new);
    let old = |v: u32| match v.checked_sub(first) {
        Some(k) => doubled[k as usize][1],
        None => v,
    };
    let mut edges: Vec<[u32; 2]> = edges
        .iter()
        .map(|edge| edge.map(old))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}
