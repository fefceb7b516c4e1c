//! Tets in the storage order of the raycaster (Morton order).

use crate::mesh::{FACES, NO_NEIGHBOUR, TetMesh, Topology};

/// A mesh with reordered tets: inputs are tet indices of the mesh, results are indices in the
/// storage order.
pub(super) struct ReorderedMesh<'a> {
    pub mesh: &'a TetMesh,
    pub topology: &'a Topology,
    pub place: &'a [u32],
}

impl ReorderedMesh<'_> {
    /// Returns, for each face in the order of the rank of its opposite node, the neighbour and the
    /// exclusive or of the neighbour's nodes.
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

    /// Returns the boundary faces of a tet: nodes, counter-clockwise from outside, and 4 tet +
    /// face.
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
