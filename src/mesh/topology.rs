//! How the tets of a mesh hang together: neighbours across faces, the boundary, the edges.

use super::TetMesh;
use rayon::slice::ParallelSliceMut;

/// The three local corners of face i, the face opposite vertex i, counter-clockwise seen from
/// outside a positively oriented tet.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The local corners at the two ends of each of a tet's six edges.
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The neighbour of a boundary face.
pub const NO_NEIGHBOUR: u32 = u32::MAX;

/// A face that belongs to one tet only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BoundaryFace {
    /// The tet it belongs to.
    pub tet: u32,
    /// Which of its faces: the one opposite this local vertex.
    pub face: u32,
}

/// Neighbours, boundary and edges of a [`TetMesh`].
#[derive(Clone, Debug)]
pub struct Topology {
    /// For face i of each tet: `4 · tet + face` of the same face as the neighbour sees it, or
    /// [`NO_NEIGHBOUR`]. Faces shared by more than two tets count as boundary of each.
    pub neighbours: Vec<[u32; 4]>,
    /// The faces without a neighbour, in the order of their tets.
    pub boundary: Vec<BoundaryFace>,
    /// Every edge once, (smaller, larger) node, sorted.
    pub edges: Vec<[u32; 2]>,
}

impl Topology {
    /// The topology of `mesh`. Time O(n log n), in parallel.
    pub fn new(mesh: &TetMesh) -> Topology {
        let mut neighbours = vec![[NO_NEIGHBOUR; 4]; mesh.tets.len()];
        for same in sorted_faces(&mesh.tets).chunk_by(|a, b| a.0 == b.0) {
            if let [(_, a), (_, b)] = same {
                neighbours[*a as usize / 4][*a as usize % 4] = *b;
                neighbours[*b as usize / 4][*b as usize % 4] = *a;
            }
        }
        let boundary = neighbours
            .iter()
            .enumerate()
            .flat_map(|(t, n)| {
                (0..4)
                    .filter(move |f| n[*f] == NO_NEIGHBOUR)
                    .map(move |f| BoundaryFace {
                        tet: t as u32,
                        face: f as u32,
                    })
            })
            .collect();
        let mut edges: Vec<[u32; 2]> = mesh
            .tets
            .iter()
            .flat_map(|t| TET_EDGES.map(|[a, b]| [t[a].min(t[b]), t[a].max(t[b])]))
            .collect();
        edges.par_sort_unstable();
        edges.dedup();
        Topology {
            neighbours,
            boundary,
            edges,
        }
    }

    /// The three nodes of boundary face `b`, counter-clockwise seen from outside.
    pub fn boundary_nodes(&self, mesh: &TetMesh, b: BoundaryFace) -> [u32; 3] {
        FACES[b.face as usize].map(|i| mesh.tets[b.tet as usize][i])
    }
}

/// Number of faces that more than two tets share.
pub(super) fn crowded_faces(tets: &[[u32; 4]]) -> usize {
    sorted_faces(tets)
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|same| same.len() > 2)
        .count()
}

/// Every face of every tet as (sorted nodes, 4 · tet + face), sorted.
fn sorted_faces(tets: &[[u32; 4]]) -> Vec<([u32; 3], u32)> {
    let mut faces: Vec<([u32; 3], u32)> = tets
        .iter()
        .enumerate()
        .flat_map(|(t, tet)| {
            (0..4).map(move |f| {
                let mut key = FACES[f].map(|i| tet[i]);
                key.sort_unstable();
                (key, (4 * t + f) as u32)
            })
        })
        .collect();
    faces.par_sort_unstable();
    faces
}
