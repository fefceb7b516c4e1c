//! Analysis of the boundary surface of a mesh: manifoldness, Euler number, connected components.

use super::{NO_NEIGHBOUR, TetMesh, Topology};
use rayon::slice::ParallelSliceMut;

/// Counts over the boundary surface, and its non-manifold edges and nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoundaryReport {
    /// Nodes on the boundary.
    pub nodes: usize,
    /// Edges of boundary faces.
    pub edges: usize,
    /// Boundary faces.
    pub faces: usize,
    /// Edges, (smaller, larger) node, that do not belong to exactly two boundary faces.
    pub non_manifold_edges: Vec<[u32; 2]>,
    /// Nodes whose boundary faces do not form a single fan around them.
    pub non_manifold_nodes: Vec<u32>,
    /// Whether every edge belongs to an even number of faces, so the surface has no rim.
    pub closed: bool,
}

impl BoundaryReport {
    /// Analyses the boundary of `mesh`. Time O(n log n) in the number of boundary faces.
    pub fn new(mesh: &TetMesh, topology: &Topology) -> BoundaryReport {
        let faces: Vec<[u32; 3]> = topology
            .boundary
            .iter()
            .map(|b| topology.boundary_nodes(mesh, *b))
            .collect();
        // (smaller node, larger node, corner of the smaller, corner of the larger)
        let mut sides: Vec<[u32; 4]> = Vec::with_capacity(3 * faces.len());
        for (f, face) in faces.iter().enumerate() {
            for i in 0..3 {
                let j = (i + 1) % 3;
                let (a, b) = ((3 * f + i) as u32, (3 * f + j) as u32);
                sides.push(match face[i] < face[j] {
                    true => [face[i], face[j], a, b],
                    false => [face[j], face[i], b, a],
                });
            }
        }
        sides.par_sort_unstable();
        let mut fans = DisjointSets::new(3 * faces.len());
        let (mut edges, mut closed, mut non_manifold_edges) = (0, true, Vec::new());
        for same in sides.chunk_by(|a, b| a[..2] == b[..2]) {
            edges += 1;
            closed &= same.len() % 2 == 0;
            if let [one, other] = same {
                fans.union(one[2], other[2]);
                fans.union(one[3], other[3]);
            } else {
                non_manifold_edges.push([same[0][0], same[0][1]]);
            }
        }
        let mut corners: Vec<(u32, u32)> = faces
            .iter()
            .flatten()
            .enumerate()
            .map(|(corner, node)| (*node, fans.find(corner as u32)))
            .collect();
        corners.par_sort_unstable();
        corners.dedup();
        let (mut nodes, mut non_manifold_nodes) = (0, Vec::new());
        for same in corners.chunk_by(|a, b| a.0 == b.0) {
            nodes += 1;
            if same.len() > 1 {
                non_manifold_nodes.push(same[0].0);
            }
        }
        BoundaryReport {
            nodes,
            edges,
            faces: faces.len(),
            non_manifold_edges,
            non_manifold_nodes,
            closed,
        }
    }

    /// Euler number: nodes − edges + faces; 2 for each sphere, 0 for each torus.
    pub fn euler_number(&self) -> i64 {
        self.nodes as i64 - self.edges as i64 + self.faces as i64
    }

    /// Whether every edge belongs to exactly two faces.
    pub fn is_edge_manifold(&self) -> bool {
        self.non_manifold_edges.is_empty()
    }

    /// Whether the surface is edge-manifold and the faces at every node form a single fan.
    pub fn is_vertex_manifold(&self) -> bool {
        self.non_manifold_edges.is_empty() && self.non_manifold_nodes.is_empty()
    }
}

/// Returns the connected component of each tet, numbered from 0 in the order of the tets, and the
/// number of components. Tets are connected through shared faces.
pub fn components(topology: &Topology) -> (Vec<u32>, usize) {
    let mut groups = DisjointSets::new(topology.neighbours.len());
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        for &n in neighbours.iter().filter(|n| **n != NO_NEIGHBOUR) {
            groups.union(t as u32, n / 4);
        }
    }
    let mut number = vec![u32::MAX; topology.neighbours.len()];
    let mut next = 0;
    let piece = (0..number.len() as u32)
        .map(|t| {
            let entry = &mut number[groups.find(t) as usize];
            if *entry == u32::MAX {
                *entry = next;
                next += 1;
            }
            *entry
        })
        .collect();
    (piece, next as usize)
}

/// Disjoint sets of items (union-find with path halving).
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    pub(crate) fn new(items: usize) -> DisjointSets {
        DisjointSets {
            parent: (0..items as u32).collect(),
        }
    }

    /// Returns the representative of the set of `item`: its smallest item.
    pub(crate) fn find(&mut self, item: u32) -> u32 {
        let mut i = item as usize;
        while self.parent[i] as usize != i {
            self.parent[i] = self.parent[self.parent[i] as usize];
            i = self.parent[i] as usize;
        }
        i as u32
    }

    pub(crate) fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
