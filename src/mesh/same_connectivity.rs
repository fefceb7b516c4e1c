//! Comparison of a mesh before and after its nodes moved.

use super::{TenNodes, TetMesh};
use crate::{Error, Result};

const ADVICE: &str = "give a deformed copy of the mesh at rest, for example from `palpate render \
    --mesh-out` or `palpate simulate`";

impl TetMesh {
    /// Checks that this mesh is `rest` with moved nodes. The tets may be in another order, and in
    /// either mesh readers flip inverted tets and drop flat ones.
    ///
    /// # Errors
    /// An [`Error::Input`] that states the difference.
    pub fn check_same_connectivity(&self, rest: &TetMesh) -> Result<()> {
        let refuse = |what: String| Err(Error::Input(format!("{what}; {ADVICE}")));
        if self.nodes.len() != rest.nodes.len() {
            return refuse(format!(
                "mesh has {} nodes, but the mesh at rest has {}",
                self.nodes.len(),
                rest.nodes.len()
            ));
        }
        if let (Some(own), Some(others)) = (self.quadratic_elements(), rest.quadratic_elements()) {
            // Which pieces a ten-node tet has depends on its shape.
            let corners = rest.mesh_of_corners(&others);
            self.mesh_of_corners(&own)
                .check_same_connectivity(&corners)?;
            let sorted = |mut elements: Vec<TenNodes>| {
                elements.iter_mut().for_each(|nodes| nodes.sort_unstable());
                elements.sort_unstable();
                elements
            };
            return match own.len() != others.len() || sorted(own) == sorted(others) {
                true => Ok(()),
                false => refuse("ten-node tets have other mid-edge nodes than at rest".into()),
            };
        }
        let sorted = |tet: &[u32; 4]| {
            let mut tet = *tet;
            tet.sort_unstable();
            tet
        };
        let mut of_rest: Vec<[u32; 4]> = rest.tets.iter().map(sorted).collect();
        of_rest.sort_unstable();
        let unknown = |tet: &&[u32; 4]| of_rest.binary_search(&sorted(tet)).is_err();
        let others = self.tets.iter().filter(unknown);
        let count = others.clone().count();
        if count > rest.repairs.degenerate {
            return match self.tets.iter().position(|tet| unknown(&tet)) {
                Some(t) => refuse(format!(
                    "tet {t} (counted from 0) has nodes {:?}, which form no tet of the mesh at \
                    rest",
                    self.tets[t]
                )),
                None => Ok(()),
            };
        }
        let missing = (rest.tets.len() + count).saturating_sub(self.tets.len());
        match missing > self.repairs.degenerate {
            true => refuse(format!(
                "mesh has {} tets, but the mesh at rest has {}",
                self.tets.len(),
                rest.tets.len()
            )),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate::bar;
    use glam::DVec3;

    #[test]
    fn same_connectivity_accepts_flipped_dropped_and_reordered_tets() {
        let rest = bar([2, 2, 2], DVec3::ONE).unwrap();
        let refused = |bent: &TetMesh| bent.check_same_connectivity(&rest).unwrap_err().to_string();
        let mut bent = rest.clone();
        bent.tets.reverse();
        bent.tets[3].swap(0, 1);
        bent.check_same_connectivity(&rest).unwrap();
        let dropped = bent.tets.pop().unwrap();
        assert!(refused(&bent).contains("39 tets"), "{}", refused(&bent));
        bent.repairs.degenerate = 1;
        bent.check_same_connectivity(&rest).unwrap();
        // Tets that are flat at rest were dropped there.
        let full = rest.clone();
        let mut short = rest.clone();
        short.tets.retain(|tet| *tet != dropped);
        assert!(full.check_same_connectivity(&short).is_err());
        short.repairs.degenerate = 1;
        full.check_same_connectivity(&short).unwrap();
        let mut other = rest.clone();
        other.tets[5] = [0, 1, 2, 26];
        assert!(refused(&other).contains("tet 5"), "{}", refused(&other));
        other.nodes.pop();
        assert!(refused(&other).contains("26 nodes"), "{}", refused(&other));
    }
}
