//! The tets at each node.

use super::stencil::Piece;

/// The incident tets of each node.
pub(super) struct Stars {
    first: Vec<u32>,
    tets: Vec<u32>,
}

impl Stars {
    pub(super) fn new(nodes: usize, pieces: &[Piece]) -> Stars {
        let mut first = vec![0u32; nodes + 1];
        for &v in pieces.iter().flat_map(|p| &p.0) {
            first[v as usize + 1] += 1;
        }
        for v in 0..nodes {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut tets = vec![0u32; 4 * pieces.len()];
        for (t, (tet, _)) in pieces.iter().enumerate() {
            for &v in tet {
                let place = &mut next[v as usize];
                tets[*place as usize] = t as u32;
                *place += 1;
            }
        }
        Stars { first, tets }
    }

    /// Returns the tets at node `v`, ascending.
    pub(super) fn of(&self, v: u32) -> &[u32] {
        let v = v as usize;
        &self.tets[self.first[v] as usize..self.first[v + 1] as usize]
    }
}
