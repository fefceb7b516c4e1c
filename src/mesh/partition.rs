//! Partitioning of meshes into pieces with ghost cells.

use super::{Field, Location, TetMesh, group_by_key};
use crate::{Error, Result};
use glam::DVec3;

/// A part of the tets of a mesh with one layer of ghost cells: the tets of other parts at its
/// nodes. With these, everything computed from the neighbourhood of a node is the same as in the
/// whole mesh.
#[derive(Clone, Debug)]
pub struct MeshPiece {
    /// Its own tets, followed by the ghost cells; tets and nodes are each in the order of the whole
    /// mesh.
    pub mesh: TetMesh,
    /// Number of owned tets.
    pub owned_tets: usize,
    /// The number of each node in the whole mesh.
    pub nodes: Vec<u32>,
    /// The number of each tet in the whole mesh.
    pub tets: Vec<u32>,
}

impl MeshPartition<'_> {
    /// Assigns each tet to a part by recursive bisection along the longest side of the bounding box of
    /// the centroids, until there are `parts` parts of nearly equal numbers of tets. Parts with
    /// consecutive numbers are mostly adjacent.
    ///
    /// # Errors
    /// An [`Error::Input`] for no parts, or more than there are tets.
    pub fn kd_parts(mesh: &TetMesh, parts: usize) -> Result<Vec<u32>> {
        let tets = mesh.tets.len();
        if parts == 0 || parts > tets {
            return Err(Error::Input(format!(
                "number of pieces must be 1 to {tets} (the number of tets), got {parts}"
            )));
        }
        let middles: Vec<DVec3> = (0..tets)
            .map(|t| mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0)
            .collect();
        let mut order: Vec<u32> = (0..tets as u32).collect();
        let mut part_of = vec![0; tets];
        let mut pending = vec![(0, tets, 0, parts)];
        while let Some((from, to, first, parts)) = pending.pop() {
            let own = &mut order[from..to];
            if parts == 1 {
                own.iter().for_each(|t| part_of[*t as usize] = first as u32);
                continue;
            }
            let (low, high) =
                own.iter()
                    .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), t| {
                        (
                            low.min(middles[*t as usize]),
                            high.max(middles[*t as usize]),
                        )
                    });
            let axis = (high - low).max_position();
            let left = parts / 2;
            let half = own.len() * left / parts;
            let key = |t: &u32| middles[*t as usize][axis];
            // Ties of centroids, as in grids, are broken by number, so the parts are deterministic.
            own.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            pending.push((from, from + half, first, left));
            pending.push((from + half, to, first + left, parts - left));
        }
        Ok(part_of)
    }
}

/// A mesh whose tets are assigned to parts.
pub struct MeshPartition<'a> {
    mesh: &'a TetMesh,
    part_of: &'a [u32],
    /// The start of each part in `own`, followed by the end of the last.
    firsts: Vec<u32>,
    own: Vec<u32>,
    /// Whether each node has tets of several parts.
    shared: Vec<bool>,
    /// The tets around those nodes.
    around: (Vec<u32>, Vec<u32>),
}

impl<'a> MeshPartition<'a> {
    /// Partitions `mesh` by `part_of`, the part of each tet; the number of parts is one more than
    /// the largest.
    ///
    /// # Errors
    /// An [`Error::Input`] if `part_of` does not have one entry per tet, or a part is empty.
    pub fn new(mesh: &'a TetMesh, part_of: &'a [u32]) -> Result<MeshPartition<'a>> {
        let parts = part_of.iter().max().map_or(0, |p| *p as usize + 1);
        if part_of.len() != mesh.tets.len() || parts > part_of.len() {
            return Err(Error::Input(format!(
                "got {} part indices for {} tets; give one per tet",
                part_of.len(),
                mesh.tets.len()
            )));
        }
        let (firsts, own) = group_by_key(parts, part_of.iter().copied().zip(0..));
        if let Some(empty) = firsts.windows(2).position(|w| w[0] == w[1]) {
            return Err(Error::Input(format!(
                "part {empty} has no tets; number the parts from 0 \
                without gaps"
            )));
        }
        let mut part_at = vec![u32::MAX; mesh.nodes.len()];
        let mut shared = vec![false; mesh.nodes.len()];
        for (tet, part) in mesh.tets.iter().zip(part_of) {
            for v in tet.map(|v| v as usize) {
                shared[v] |= part_at[v] != u32::MAX && part_at[v] != *part;
                part_at[v] = *part;
            }
        }
        let corners = (0..).zip(&mesh.tets);
        let corners = corners.flat_map(|(t, tet)| tet.map(move |v| (v, t)));
        let at_seams = corners.filter(|(v, _)| shared[*v as usize]);
        let around = group_by_key(mesh.nodes.len(), at_seams);
        Ok(MeshPartition {
            mesh,
            part_of,
            firsts,
            own,
            shared,
            around,
        })
    }

    /// Returns the number of parts.
    pub fn len(&self) -> usize {
        self.firsts.len() - 1
    }

    /// Whether there are no parts.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Extracts part `number` with its ghost cells.
    ///
    /// # Errors
    /// An [`Error::Input`] for an invalid number.
    pub fn extract(&self, number: usize) -> Result<MeshPiece> {
        let Some([first, last]) = self.firsts.get(number..number + 2) else {
            return Err(Error::Input(format!(
                "part {number} does not exist; index must be < {} (counted from 0)",
                self.len()
            )));
        };
        let mesh = self.mesh;
        let mut tets = self.own[*first as usize..*last as usize].to_vec();
        let own = tets.len();
        let corners = |tets: &[u32]| {
            let mut nodes: Vec<u32> = tets.iter().flat_map(|t| mesh.tets[*t as usize]).collect();
            nodes.sort_unstable();
            nodes.dedup();
            nodes
        };
        let (firsts, items) = &self.around;
        let seam = corners(&tets)
            .into_iter()
            .filter(|v| self.shared[*v as usize]);
        let beside =
            seam.flat_map(|v| &items[firsts[v as usize] as usize..firsts[v as usize + 1] as usize]);
        let others = beside.filter(|t| self.part_of[**t as usize] as usize != number);
        let mut others: Vec<u32> = others.copied().collect();
        others.sort_unstable();
        others.dedup();
        tets.extend(others);
        let nodes = corners(&tets);
        let local = |v: u32| nodes.partition_point(|w| *w < v) as u32;
        let picked = |field: &Field| {
            let items = match field.location {
                Location::Node => &nodes,
                Location::Cell => &tets,
            };
            let width = field.components;
            let tuple = |i: &u32| &field.values[*i as usize * width..(*i as usize + 1) * width];
            Field {
                values: items.iter().flat_map(tuple).copied().collect(),
                name: field.name.clone(),
                ..*field
            }
        };
        let piece = TetMesh {
            nodes: nodes.iter().map(|v| mesh.nodes[*v as usize]).collect(),
            tets: tets
                .iter()
                .map(|t| mesh.tets[*t as usize].map(local))
                .collect(),
            fields: mesh.fields.iter().map(picked).collect(),
            region_names: mesh.region_names.clone(),
            length_unit: mesh.length_unit,
            frame: mesh.frame,
            ..TetMesh::default()
        };
        Ok(MeshPiece {
            mesh: piece,
            owned_tets: own,
            nodes,
            tets,
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::mesh::{NO_NEIGHBOUR, Topology};

    #[test]
    fn kd_partition_is_balanced_and_covers_every_tet_once() {
        let mesh = generate::by_name("limb", Some(3000)).unwrap();
        for parts in [1, 2, 3, 7, 64] {
            let part_of = MeshPartition::kd_parts(&mesh, parts).unwrap();
            let mut counts = vec![0; parts];
            part_of.iter().for_each(|p| counts[*p as usize] += 1);
            let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
            assert!(most - least <= 6, "{parts}: {counts:?}");
            assert_eq!(part_of, MeshPartition::kd_parts(&mesh, parts).unwrap());
        }
        assert!(MeshPartition::kd_parts(&mesh, 0).is_err());
        assert!(MeshPartition::kd_parts(&mesh, mesh.tets.len() + 1).is_err());
    }

    #[test]
    fn piece_contains_all_tets_around_its_nodes() {
        let mut mesh = generate::by_name("limb", Some(2000)).unwrap();
        let number = |t: usize| t as f64;
        let tets = (0..mesh.tets.len()).map(number).collect();
        mesh.set_field(Field::scalar("number", Location::Cell, tets))
            .unwrap();
        let part_of = MeshPartition::kd_parts(&mesh, 5).unwrap();
        let parted = MeshPartition::new(&mesh, &part_of).unwrap();
        let whole = Topology::new(&mesh);
        let mut around = vec![0; mesh.nodes.len()];
        mesh.tets
            .iter()
            .flatten()
            .for_each(|v| around[*v as usize] += 1);
        let mut owned = 0;
        for k in 0..parted.len() {
            let piece = parted.extract(k).unwrap();
            owned += piece.owned_tets;
            assert!(piece.tets.len() > piece.owned_tets);
            let numbers = piece.mesh.field("number", Location::Cell).unwrap();
            assert!(
                numbers
                    .values
                    .iter()
                    .zip(&piece.tets)
                    .all(|(a, b)| *a == f64::from(*b))
            );
            let topology = Topology::new(&piece.mesh);
            let mut here = vec![0; piece.nodes.len()];
            piece
                .mesh
                .tets
                .iter()
                .flatten()
                .for_each(|v| here[*v as usize] += 1);
            for t in 0..piece.owned_tets {
                for v in piece.mesh.tets[t] {
                    let of_whole = piece.nodes[v as usize] as usize;
                    assert_eq!(here[v as usize], around[of_whole]);
                    assert_eq!(piece.mesh.nodes[v as usize], mesh.nodes[of_whole]);
                }
                // Boundary faces of its own tets are boundary faces of the whole mesh.
                let theirs = whole.neighbours[piece.tets[t] as usize];
                for (a, b) in topology.neighbours[t].iter().zip(theirs) {
                    assert_eq!(*a == NO_NEIGHBOUR, b == NO_NEIGHBOUR);
                }
            }
            // Restricted to its own tets, cut faces are boundary, too, and ghost cells have none.
            let shown = topology.restricted_to(piece.owned_tets);
            assert!(
                shown
                    .boundary
                    .iter()
                    .all(|b| (b.tet as usize) < piece.owned_tets)
            );
            assert!(
                shown.boundary.len()
                    > topology
                        .boundary
                        .iter()
                        .filter(|b| (b.tet as usize) < piece.owned_tets)
                        .count()
            );
        }
        assert_eq!(owned, mesh.tets.len());
        assert!(parted.extract(5).is_err());
        assert!(MeshPartition::new(&mesh, &part_of[1..]).is_err());
    }
}
