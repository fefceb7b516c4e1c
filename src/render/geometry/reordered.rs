//! Tets where the raycaster keeps them: along a Morton curve.

use crate::mesh::{FACES, NO_NEIGHBOUR, TetMesh, Topology};

/// A mesh whose tets are kept elsewhere than they are listed: tets are asked for by their number
/// in the mesh, and told by their place.
pub(super) struct ReorderedMesh<'a> {
    pub mesh: &'a TetMesh,
    pub topology: &'a Topology,
    pub place: &'a [u32],
}

impl ReorderedMesh<'_> {
    /// Across the face opposite the k-th smallest node: the neighbour, and the exclusive or of
    /// its nodes.
    pub fn links(&self, t: u32) -> [[u32; 2]; 4] {
        let (tet, across) = (
            self.mesh.tets[t as usize],
            self.topology.neighbours[t as usize],
        );
        let mut ranked = [0, 1, 2, 3];
        ranked.sort_by_key(|i: &usize| tet[*i]);
        ranked.map(|i| match across[i] {
            NO_NEIGHBOUR => [NO_NEIGHBOUR, 0],
            code => {
                let [a, b, c, d] = self.mesh.tets[code as usize / 4];
                [self.place[code as usize / 4], a ^ b ^ c ^ d]
            }
        })
    }

    /// Its boundary faces: nodes, counter-clockwise from outside, and 4 tet + face.
    pub fn boundary_faces(&self, t: u32) -> impl Iterator<Item = [u32; 4]> + use<> {
        let (tet, across) = (
            self.mesh.tets[t as usize],
            self.topology.neighbours[t as usize],
        );
        let place = self.place[t as usize];
        (0..4)
            .filter(move |f| across[*f] == NO_NEIGHBOUR)
            .map(move |f| {
                let [a, b, c] = FACES[f].map(|i| tet[i]);
                [a, b, c, 4 * place + f as u32]
            })
    }
}
