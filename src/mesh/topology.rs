//! Connectivity of the tets of a mesh: neighbours across faces, and the boundary.

use super::TetMesh;
use super::group_by::map_groups;

/// The three local corners of face i, the face opposite vertex i, counter-clockwise seen from
/// outside a positively oriented tet.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The local corners at the two ends of each of a tet's six edges.
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Marks a boundary face in the list of neighbours.
pub const NO_NEIGHBOUR: u32 = u32::MAX;

/// A face that belongs to one tet only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BoundaryFace {
    /// The tet it belongs to.
    pub tet: u32,
    /// Local index of the face: that of the opposite vertex.
    pub face: u32,
}

/// Neighbours and boundary of a [`TetMesh`].
#[derive(Clone, Debug)]
pub struct Topology {
    /// For face i of each tet: `4 · tet + face` of the same face as the neighbour sees it, or
    /// [`NO_NEIGHBOUR`]. Faces shared by more than two tets count as boundary of each.
    pub neighbours: Vec<[u32; 4]>,
    /// The faces without a neighbour, in the order of their tets.
    pub boundary: Vec<BoundaryFace>,
}

impl Topology {
    /// Builds the topology of `mesh`, in parallel. The time is linear in the tets and logarithmic
    /// in the number of tets per node.
    pub fn new(mesh: &TetMesh) -> Topology {
        let mut neighbours = vec![[NO_NEIGHBOUR; 4]; mesh.tets.len()];
        let pairs = same_faces(&mesh.tets, |same, pairs| {
            if let [[.., a], [.., b]] = same {
                pairs.push([*a, *b]);
            }
        });
        for [a, b] in pairs {
            neighbours[a as usize / 4][a as usize % 4] = b;
            neighbours[b as usize / 4][b as usize % 4] = a;
        }
        Topology {
            boundary: faces_without_neighbour(&neighbours),
            neighbours,
        }
    }

    /// Returns the topology for rays restricted to the first `own` tets, as in a piece with ghost
    /// cells: faces shared with ghost cells become boundary, and the ghost cells have no neighbours
    /// (each is its own neighbour on all sides).
    pub fn restricted_to(&self, own: usize) -> Topology {
        let mut neighbours = self.neighbours.clone();
        for (t, across) in neighbours.iter_mut().enumerate() {
            for (f, code) in across.iter_mut().enumerate() {
                if t >= own {
                    *code = (4 * t + f) as u32;
                } else if *code != NO_NEIGHBOUR && *code as usize / 4 >= own {
                    *code = NO_NEIGHBOUR;
                }
            }
        }
        Topology {
            boundary: faces_without_neighbour(&neighbours),
            neighbours,
        }
    }

    /// Returns the three nodes of boundary face `b`, counter-clockwise seen from outside.
    pub fn boundary_nodes(&self, mesh: &TetMesh, b: BoundaryFace) -> [u32; 3] {
        FACES[b.face as usize].map(|i| mesh.tets[b.tet as usize][i])
    }

    /// Returns the mean chord length of the body of `mesh`, its mean thickness: 4 V / S with the
    /// volume V and the boundary area S (Cauchy's formula).
    pub fn mean_chord(&self, mesh: &TetMesh) -> f64 {
        let triangles = self.boundary_triangles(mesh).into_iter();
        let areas = triangles.map(|face| {
            let [a, b, c] = face.map(|v| mesh.nodes[v as usize]);
            0.5 * (b - a).cross(c - a).length()
        });
        4.0 * mesh.volume() / areas.sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// Returns the nodes of all boundary faces, in increasing order.
    pub fn all_boundary_nodes(&self, mesh: &TetMesh) -> Vec<u32> {
        let mut nodes = self.boundary_triangles(mesh).into_flattened();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Returns the nodes of every boundary face, as [`Topology::boundary_nodes`].
    pub fn boundary_triangles(&self, mesh: &TetMesh) -> Vec<[u32; 3]> {
        let faces = self.boundary.iter();
        faces.map(|b| self.boundary_nodes(mesh, *b)).collect()
    }
}

/// Returns the faces without a neighbour, in the order of their tets.
fn faces_without_neighbour(neighbours: &[[u32; 4]]) -> Vec<BoundaryFace> {
    let of_tet = |(t, across): (usize, &[u32; 4])| {
        let across = *across;
        let faces = (0..4).filter(move |f| across[*f] == NO_NEIGHBOUR);
        faces.map(move |f| BoundaryFace {
            tet: t as u32,
            face: f as u32,
        })
    };
    neighbours.iter().enumerate().flat_map(of_tet).collect()
}

/// Counts the faces shared by more than two tets.
pub(super) fn crowded_faces(tets: &[[u32; 4]]) -> usize {
    let crowded = same_faces(tets, |same, crowded| {
        if same.len() > 2 {
            crowded.push(());
        }
    });
    crowded.len()
}

/// Concatenates the items that `emit` pushes for each face of `tets`, given once per incident tet:
/// its nodes in ascending order, and 4 tet + face.
fn same_faces<B: Send>(
    tets: &[[u32; 4]],
    emit: impl Fn(&[[u32; 4]], &mut Vec<B>) + Sync,
) -> Vec<B> {
    // Grouped by smallest node: most meshes have fewer nodes than that, and none may be listed.
    let groups = tets.len() / 4 + 1;
    let faces = tets.iter().enumerate().flat_map(|(t, tet)| {
        (0..4).map(move |f| {
            let mut key = FACES[f].map(|i| tet[i]);
            key.sort_unstable();
            let [a, b, c] = key;
            ((a as usize % groups) as u32, [a, b, c, (4 * t + f) as u32])
        })
    });
    map_groups(groups, faces, |own, output| {
        for same in own.chunk_by(|a, b| a[..3] == b[..3]) {
            emit(same, output);
        }
    })
}
