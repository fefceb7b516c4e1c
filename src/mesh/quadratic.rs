//! Ten-node tets, stored as groups of eight linear ones.
//!
//! A body of order 2 is drawn, picked, cut and touched as a mesh of linear tets with the same nodes:
//! tets 8k to 8k + 7 are the pieces of its k-th element. The first four lie at its corners, with the
//! corner in the element's place among their nodes; the other four fill the octahedron in between.

use super::{Field, Location, TET_EDGES, TetMesh, signed_volume};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;
use std::fmt;

/// Number of linear tets of a ten-node tet.
pub(crate) const PIECES: usize = 8;

/// Largest number of nodes of a mesh.
const MAX_NODES: usize = u32::MAX as usize;

/// Order of the finite elements of a body: the degree of their shape functions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ElementOrder {
    /// Linear tets.
    #[default]
    Linear,
    /// Quadratic tets, with ten nodes.
    Quadratic,
}

impl ElementOrder {
    /// The order as a number.
    pub fn number(self) -> u32 {
        match self {
            ElementOrder::Linear => 1,
            ElementOrder::Quadratic => 2,
        }
    }

    /// The order `number`.
    ///
    /// # Errors
    /// [`Error::Input`] if it is neither 1 nor 2.
    pub fn from_number(number: i64) -> Result<ElementOrder> {
        match number {
            1 => Ok(ElementOrder::Linear),
            2 => Ok(ElementOrder::Quadratic),
            _ => Err(Error::Input(format!(
                "unknown order {number} of the elements; expected 1 (linear tets) or 2 (quadratic tets)"
            ))),
        }
    }
}

impl fmt::Display for ElementOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.number())
    }
}

/// The ten nodes of an element: its corners, then the middles of its edges in the order of
/// [`TET_EDGES`].
pub(crate) type TenNodes = [u32; 10];

impl TetMesh {
    /// Returns this mesh with a node in the middle of each edge and each tet replaced by eight: the
    /// mesh of a body of order 2. The nodes of this mesh come first, in their order. Fields of tets
    /// are repeated; fields of nodes are averaged along edges, except that whole numbers (labels) are
    /// taken from the first node. A mesh of order 2 is returned as it is.
    ///
    /// # Errors
    /// [`Error::Input`] if the mesh would have too many nodes.
    pub fn with_mid_edge_nodes(&self) -> Result<TetMesh> {
        match self.order {
            ElementOrder::Linear => self.with_middles(|_| None),
            ElementOrder::Quadratic => Ok(self.clone()),
        }
    }

    /// As [`TetMesh::with_mid_edge_nodes`] for a mesh of order 1 that has the nodes in the middle of
    /// some edges already: `given` returns them by (smaller, larger) corner.
    pub(super) fn with_middles(&self, given: impl Fn([u32; 2]) -> Option<u32>) -> Result<TetMesh> {
        let edges = self.edges();
        let mut bare: Vec<[u32; 2]> = Vec::new();
        let middles: Vec<u32> = edges
            .iter()
            .map(|edge| {
                given(*edge).unwrap_or_else(|| {
                    bare.push(*edge);
                    (self.nodes.len() + bare.len() - 1) as u32
                })
            })
            .collect();
        if self.nodes.len().saturating_add(bare.len()) > MAX_NODES {
            return Err(Error::Input(format!(
                "order 2 needs a node on each of {} edges, more than a mesh can have; use order 1 or a coarser mesh",
                edges.len()
            )));
        }
        let middle = |a: u32, b: u32| {
            let edge = [a.min(b), a.max(b)];
            // Every edge of a tet is among them.
            middles[edges.binary_search(&edge).unwrap_or_default()]
        };
        let mut nodes = self.nodes.clone();
        nodes.extend(bare.iter().map(|[a, b]| {
            let [a, b] = [a, b].map(|v| self.nodes[*v as usize]);
            a.midpoint(b)
        }));
        let groups = parallel::map(self.tets.len(), |t| {
            let tet = self.tets[t];
            let middles = TET_EDGES.map(|[a, b]| middle(tet[a], tet[b]));
            pieces(tet, middles, &nodes)
        });
        let fields = self.fields.iter().map(|f| refined_field(f, &bare));
        Ok(TetMesh {
            tets: groups.into_iter().flatten().collect(),
            fields: fields.collect(),
            nodes,
            order: ElementOrder::Quadratic,
            region_names: self.region_names.clone(),
            length_unit: self.length_unit,
            frame: self.frame,
            repairs: self.repairs.clone(),
        })
    }

    /// Returns which nodes are in the middle of an edge of a ten-node tet: none if the tets are not
    /// pieces of ten-node tets.
    pub fn mid_edge_nodes(&self) -> Vec<bool> {
        let mut middles = vec![false; self.nodes.len()];
        for nodes in self.ten_node_tets().unwrap_or_default() {
            nodes[4..].iter().for_each(|v| middles[*v as usize] = true);
        }
        middles
    }

    /// Returns the ten-node tets that the tets of this mesh are the pieces of.
    ///
    /// # Errors
    /// [`Error::Input`] if the tets are not pieces of ten-node tets in groups of eight.
    pub fn ten_node_tets(&self) -> Result<Vec<TenNodes>> {
        let groups = self.tets.chunks(PIECES);
        let elements: Option<Vec<TenNodes>> = groups.map(ten_nodes).collect();
        elements.ok_or_else(|| {
            Error::Input(
                "order 2 requires a mesh whose tets are the pieces of ten-node tets; create it with TetMesh::with_mid_edge_nodes"
                    .into(),
            )
        })
    }
}

/// Returns the shares of an even traction on a face among its nodes, of which some are in the middle
/// of edges of ten-node tets: the integrals of the shape functions. On a face of a ten-node tet they
/// are 0 at the corners and ⅓ at each middle; of the four pieces of the face, each gives its part to
/// its middles.
pub(crate) fn traction_shares(is_middle: [bool; 3]) -> [f64; 3] {
    let middles = is_middle.iter().filter(|is| **is).count();
    match middles {
        0 => [1.0 / 3.0; 3],
        _ => is_middle.map(|is| f64::from(u8::from(is)) / middles as f64),
    }
}

/// Returns the nodes of the element with these pieces; `None` if they are not its pieces.
pub(crate) fn ten_nodes(group: &[[u32; 4]]) -> Option<TenNodes> {
    let corners = group.first_chunk::<4>()?;
    if group.len() != PIECES {
        return None;
    }
    let mut nodes = [0; 10];
    for (a, piece) in corners.iter().enumerate() {
        nodes[a] = piece[a];
    }
    for (edge, [a, b]) in TET_EDGES.into_iter().enumerate() {
        if corners[a][b] != corners[b][a] {
            return None;
        }
        nodes[4 + edge] = corners[a][b];
    }
    let inner = group[4..].iter().flatten();
    let are_middles = inner.into_iter().all(|v| nodes[4..].contains(v));
    are_middles.then_some(nodes)
}

/// Returns the eight pieces of a tet with these nodes in the middle of its edges. The octahedron is
/// divided along its shortest diagonal.
pub(super) fn pieces(tet: [u32; 4], middles: [u32; 6], nodes: &[DVec3]) -> [[u32; 4]; PIECES] {
    let [ab, ac, ad, bc, bd, cd] = middles;
    let [a, b, c, d] = tet;
    let at = |v: u32| nodes[v as usize];
    // Each diagonal, and the other four middles in the order of a walk around it.
    let diagonals = [
        ([ab, cd], [ac, bc, bd, ad]),
        ([ac, bd], [ab, bc, cd, ad]),
        ([ad, bc], [ab, bd, cd, ac]),
    ];
    let length = |d: &([u32; 2], [u32; 4])| at(d.0[0]).distance_squared(at(d.0[1]));
    let shortest = |x, y| if length(&y) < length(&x) { y } else { x };
    let ([p, q], ring) = diagonals.into_iter().fold(diagonals[0], shortest);
    let inner = |k: usize| {
        let piece = [p, q, ring[k], ring[(k + 1) % 4]];
        match signed_volume(piece.map(at)) < 0.0 {
            true => [p, q, piece[3], piece[2]],
            false => piece,
        }
    };
    [
        [a, ab, ac, ad],
        [ab, b, bc, bd],
        [ac, bc, c, cd],
        [ad, bd, cd, d],
        inner(0),
        inner(1),
        inner(2),
        inner(3),
    ]
}

fn refined_field(field: &Field, edges: &[[u32; 2]]) -> Field {
    let width = field.components;
    let mut values = Vec::new();
    match field.location {
        Location::Cell => {
            for cell in field.values.chunks(width.max(1)) {
                (0..PIECES).for_each(|_| values.extend_from_slice(cell));
            }
        }
        Location::Node => {
            let labels = field.values.iter().all(|x| x.fract() == 0.0);
            values.extend_from_slice(&field.values);
            for [a, b] in edges.iter().map(|e| e.map(|v| v as usize)) {
                for k in 0..width {
                    let (x, y) = (field.values[a * width + k], field.values[b * width + k]);
                    values.push(if labels { x } else { 0.5 * (x + y) });
                }
            }
        }
    }
    Field {
        values,
        ..field.clone()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    #[test]
    fn pieces_fill_the_tets_and_give_the_elements_back() {
        let mesh = generate::bar([3, 2, 2], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let refined = mesh.with_mid_edge_nodes().unwrap();
        assert_eq!(refined.nodes[..mesh.nodes.len()], mesh.nodes[..]);
        assert_eq!(refined.nodes.len(), mesh.nodes.len() + mesh.edges().len());
        for (t, group) in refined.tets.chunks(PIECES).enumerate() {
            let volumes = group.iter().map(|piece| {
                let volume = signed_volume(piece.map(|v| refined.nodes[v as usize]));
                assert!((volume - mesh.tet_volume(t) / 8.0).abs() < 1e-15);
                volume
            });
            assert!((volumes.sum::<f64>() - mesh.tet_volume(t)).abs() < 1e-15);
        }
        let elements = refined.ten_node_tets().unwrap();
        for (nodes, tet) in elements.iter().zip(&mesh.tets) {
            assert_eq!(nodes[..4], tet[..]);
            for (edge, [a, b]) in TET_EDGES.into_iter().enumerate() {
                let ends = [a, b].map(|k| mesh.nodes[tet[k] as usize]);
                assert_eq!(
                    refined.nodes[nodes[4 + edge] as usize],
                    ends[0].midpoint(ends[1])
                );
            }
        }
        assert!(mesh.ten_node_tets().is_err());
    }
}
