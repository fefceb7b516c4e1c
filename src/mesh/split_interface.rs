//! Splitting of interfaces between regions that share nodes.

use super::{Bvh, FACES, Field, Location, TetMesh, Topology, edge_face_intersections};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// Displacements of nodes that penetrate their surroundings are halved up to this many times, then
/// set to zero.
const MAX_GAP_HALVINGS: usize = 4;

impl TetMesh {
    /// Returns the label of a region given as an integer or by its name in the mesh.
    ///
    /// # Errors
    /// An [`Error::Input`] that lists the valid names.
    pub fn region_label(&self, region: &str) -> Result<i64> {
        if let Ok(label) = region.parse() {
            return Ok(label);
        }
        let mut names = self.region_names.iter();
        let found = names.find(|(_, known)| known.eq_ignore_ascii_case(region));
        found.map(|(label, _)| *label).ok_or_else(|| {
            let names: Vec<&str> = self.region_names.values().map(String::as_str).collect();
            Error::Input(match names.as_slice() {
                [] => format!(
                    "unknown region \"{region}\": the regions of the mesh have no names; give an \
                    integer label"
                ),
                _ => format!(
                    "unknown region \"{region}\"; available regions: {}",
                    names.join(", ")
                ),
            })
        })
    }

    /// Splits the interface between the regions with these labels, which share nodes: common nodes
    /// are duplicated, and the tets of `second` use the duplicates, so the faces between the
    /// regions become boundary faces on either side. The tets keep their order; the duplicates are
    /// last, at the positions and with the values of their originals.
    ///
    /// A node around which other regions connect the two through faces stays shared: the seam ends
    /// there. If two regions meet in faces and have no other nodes, all of them are duplicated, and
    /// whatever is in between stays with `first`.
    ///
    /// Returns each duplicate with its original node.
    ///
    /// # Errors
    /// An [`Error::Input`] if the mesh has no region field, if both regions are the same, and if
    /// they share no node that can be split.
    pub fn split_interface(&mut self, first: i64, second: i64) -> Result<Vec<[u32; 2]>> {
        let labels = self.field("label", Location::Cell);
        let Some(labels) = labels.or_else(|| self.region_field()) else {
            return Err(Error::Input(
                "mesh has no region field; splitting an interface requires a cell field of integer \
                region labels, such as `label`".into(),
            ));
        };
        let is = |t: usize, label: i64| labels.values[t] == label as f64;
        let mut shared = vec![0u8; self.nodes.len()];
        for (t, tet) in self.tets.iter().enumerate() {
            let side = u8::from(is(t, first)) + 2 * u8::from(is(t, second));
            for v in tet {
                shared[*v as usize] |= side;
            }
        }
        let side = |t: usize| u8::from(is(t, first)) + 2 * u8::from(is(t, second));
        let mut welded = self.welded_nodes(&shared, side);
        let meet = (0..self.nodes.len() as u32).filter(|v| shared[*v as usize] == 3);
        if meet.clone().all(|v| welded.contains(&v)) && self.meet_in_faces(&shared, side) {
            // The regions are so narrow at the interface that they have no unshared node there.
            welded.clear();
        }
        let mut double = vec![u32::MAX; self.nodes.len()];
        let mut made = Vec::new();
        let parts = |v: &usize| shared[*v] == 3 && !welded.contains(&(*v as u32));
        for v in (0..self.nodes.len()).filter(parts) {
            double[v] = (self.nodes.len() + made.len()) as u32;
            made.push([double[v], v as u32]);
        }
        if first == second || made.is_empty() {
            let name = |label: i64| match self.region_names.get(&label) {
                Some(name) => format!("\"{name}\" ({label})"),
                None => format!("{label}"),
            };
            return Err(Error::Input(format!(
                "regions {} and {} share no nodes to split; choose two regions with common faces",
                name(first),
                name(second)
            )));
        }
        let theirs: Vec<usize> = (0..self.tets.len()).filter(|t| is(*t, second)).collect();
        for t in theirs {
            for v in &mut self.tets[t] {
                if double[*v as usize] != u32::MAX {
                    *v = double[*v as usize];
                }
            }
        }
        for [_, v] in &made {
            self.nodes.push(self.nodes[*v as usize]);
        }
        for Field {
            location,
            components,
            values,
            ..
        } in &mut self.fields
        {
            if *location == Location::Node {
                for [_, v] in &made {
                    let from = *v as usize * *components;
                    values.extend_from_within(from..from + *components);
                }
            }
        }
        Ok(made)
    }

    /// Whether tets of one `side` (1 or 2, or neither) share faces with those of the other.
    fn meet_in_faces(&self, shared: &[u8], side: impl Fn(usize) -> u8) -> bool {
        let mut faces: BTreeMap<[u32; 3], u8> = BTreeMap::new();
        for (t, tet) in self.tets.iter().enumerate().filter(|(t, _)| side(*t) != 0) {
            for face in FACES {
                let mut nodes = face.map(|k| tet[k]);
                if nodes.iter().all(|v| shared[*v as usize] == 3) {
                    nodes.sort_unstable();
                    *faces.entry(nodes).or_default() |= side(t);
                }
            }
        }
        faces.values().any(|sides| *sides == 3)
    }

    /// Returns the nodes of both sides of a seam (value 3 in `shared`) around which the tets of one
    /// `side` (1 or 2, or neither) are connected to those of the other, but not by faces between
    /// the two.
    fn welded_nodes(&self, shared: &[u8], side: impl Fn(usize) -> u8) -> BTreeSet<u32> {
        let mut around: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (t, tet) in self.tets.iter().enumerate() {
            for v in tet.iter().filter(|v| shared[**v as usize] == 3) {
                around.entry(*v).or_default().push(t);
            }
        }
        let mut welded = BTreeSet::new();
        for (v, tets) in around {
            let share_face = |a: usize, b: usize| {
                let common = self.tets[a].iter().filter(|v| self.tets[b].contains(v));
                common.count() == 3
            };
            let mut reached: Vec<bool> = tets.iter().map(|t| side(*t) == 1).collect();
            let mut front: Vec<usize> = (0..tets.len()).filter(|k| reached[*k]).collect();
            while let Some(k) = front.pop() {
                for n in 0..tets.len() {
                    let seam = side(tets[k]) + side(tets[n]) == 3
                        && side(tets[k]) != 0
                        && side(tets[n]) != 0;
                    if !reached[n] && !seam && share_face(tets[k], tets[n]) {
                        reached[n] = true;
                        front.push(n);
                    }
                }
            }
            if tets.iter().zip(&reached).any(|(t, r)| *r && side(*t) == 2) {
                welded.insert(v);
            }
        }
        welded
    }

    /// Opens a gap of width `gap` between the two sides of a seam: moves `doubles`, as returned by
    /// [`TetMesh::split_interface`], and their originals by half of it each along the normals of
    /// the seam. This separates the two sides before contact between them. If nodes would penetrate
    /// the surroundings of the seam, the gap is reduced; duplicates that cannot be separated are
    /// merged again, which renumbers others.
    ///
    /// # Errors
    /// An [`Error::Input`] for an invalid gap, or one so wide that it would invert tets.
    pub fn open_interface_gap(&mut self, doubles: &[[u32; 2]], gap: f64) -> Result<()> {
        let wrong = |why: &str| {
            Err(Error::Input(format!(
                "cannot open an interface gap of {gap}: {why}"
            )))
        };
        if !(gap.is_finite() && gap >= 0.0) {
            return wrong("must be a finite length ≥ 0");
        }
        if gap == 0.0 {
            return Ok(());
        }
        let double: BTreeMap<u32, u32> = doubles.iter().map(|[v, from]| (*v, *from)).collect();
        let mut normals: BTreeMap<u32, DVec3> = BTreeMap::new();
        let topology = Topology::new(self);
        let sorted = |mut nodes: [u32; 3]| {
            nodes.sort_unstable();
            nodes
        };
        let faces = topology.boundary.iter();
        let faces: Vec<[u32; 3]> = faces.map(|f| topology.boundary_nodes(self, *f)).collect();
        let known: BTreeSet<[u32; 3]> = faces.iter().map(|nodes| sorted(*nodes)).collect();
        for nodes in faces.iter().copied() {
            // The original face: at the rim the two sides share nodes.
            let other = nodes.map(|v| double.get(&v).copied().unwrap_or(v));
            if other != nodes && known.contains(&sorted(other)) {
                let [a, b, c] = nodes.map(|v| self.nodes[v as usize]);
                for v in nodes.into_iter().filter(|v| double.contains_key(v)) {
                    *normals.entry(v).or_default() += (b - a).cross(c - a);
                }
            }
        }
        let mut displacements: BTreeMap<u32, DVec3> = BTreeMap::new();
        for (v, normal) in normals {
            let by = 0.5 * gap * normal.normalize_or_zero();
            *displacements.entry(v).or_default() -= by;
            *displacements.entry(double[&v]).or_default() += by;
        }
        let before = self.nodes.clone();
        for (v, by) in &displacements {
            self.nodes[*v as usize] += *by;
        }
        if !(0..self.tets.len()).all(|t| self.tet_volume(t) > 0.0) {
            self.nodes = before;
            return wrong("adjacent tets would invert; reduce the gap or refine the mesh");
        }
        self.halve_displacements(&before, displacements, &faces);
        self.rejoin_nodes(doubles, 1e-3 * gap);
        Ok(())
    }

    /// Merges duplicates that are still nearer than `gap` to their originals with these.
    fn rejoin_nodes(&mut self, doubles: &[[u32; 2]], gap: f64) {
        let near = |[v, from]: &&[u32; 2]| {
            let distance = self.nodes[*v as usize].distance(self.nodes[*from as usize]);
            distance <= gap
        };
        let joined: BTreeMap<u32, u32> =
            doubles.iter().filter(near).map(|[v, w]| (*v, *w)).collect();
        if joined.is_empty() {
            return;
        }
        for v in self.tets.iter_mut().flatten() {
            *v = joined.get(v).copied().unwrap_or(*v);
        }
        let known = self.repairs.unused_nodes;
        self.drop_unused_nodes();
        self.repairs.unused_nodes = known;
    }

    /// Halves the displacements `displacements` of nodes repeatedly until none of their edges
    /// intersects a boundary face.
    fn halve_displacements(
        &mut self,
        before: &[DVec3],
        mut displacements: BTreeMap<u32, DVec3>,
        faces: &[[u32; 3]],
    ) {
        let mut edges: Vec<[u32; 2]> = faces
            .iter()
            .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [*a.min(b), *a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let middle = |k: usize| faces[k].iter().map(|v| before[*v as usize]).sum::<DVec3>() / 3.0;
        let mut tree = Bvh::new(faces.len(), middle);
        for round in 0..2 * MAX_GAP_HALVINGS {
            let (nodes, edge) = (&self.nodes, |k: usize| edges[k]);
            let at = |v: u32| nodes[v as usize];
            let found = edge_face_intersections((edges.len(), edge), |k| faces[k], &mut tree, at);
            let mut back = BTreeSet::new();
            for crossing in found {
                back.extend(edges[crossing.edge]);
                back.extend(faces[crossing.face]);
            }
            back.retain(|v| {
                displacements
                    .get(v)
                    .is_some_and(|shift| *shift != DVec3::ZERO)
            });
            if back.is_empty() {
                break;
            }
            for v in back {
                let part = if round < MAX_GAP_HALVINGS { 0.5 } else { 0.0 };
                let shift = displacements.entry(v).or_default();
                *shift *= part;
                self.nodes[v as usize] = before[v as usize] + *shift;
            }
        }
    }

    /// Calls [`TetMesh::split_interface`] for every pair of regions, given by name or label.
    ///
    /// # Errors
    /// As [`TetMesh::region_label`] and [`TetMesh::split_interface`].
    pub fn split_interfaces(&mut self, pairs: &[[String; 2]]) -> Result<()> {
        for [first, second] in pairs {
            let (first, second) = (self.region_label(first)?, self.region_label(second)?);
            self.split_interface(first, second)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    /// A bar of 4×4×2 cells: region 1 is x < 2, 2 beyond it with y < 2, 3 the rest.
    fn bar() -> TetMesh {
        let mut mesh = generate::bar([4, 4, 2], DVec3::new(4.0, 4.0, 2.0)).unwrap();
        let labels = (0..mesh.tets.len()).map(|t| {
            let p = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0 - mesh.bounds().0;
            match (p.x < 2.0, p.y < 2.0) {
                (true, _) => 1.0,
                (_, true) => 2.0,
                _ => 3.0,
            }
        });
        let labels = Field::scalar("label", Location::Cell, labels.collect());
        mesh.set_field(labels).unwrap();
        let places = mesh.nodes.iter().flat_map(|p| [p.x, p.y]).collect();
        mesh.set_field(Field {
            components: 2,
            ..Field::scalar("place", Location::Node, places)
        })
        .unwrap();
        mesh.region_names = [(1, "thigh".to_owned()), (2, "shin".to_owned())].into();
        mesh
    }

    fn nodes_of(mesh: &TetMesh, label: f64) -> std::collections::BTreeSet<u32> {
        let labels = &mesh.field("label", Location::Cell).unwrap().values;
        let tets = mesh.tets.iter().zip(labels).filter(|(_, l)| **l == label);
        tets.flat_map(|(t, _)| *t).collect()
    }

    #[test]
    fn split_regions_share_no_nodes_and_rest_is_unchanged() {
        let before = bar();
        let topology = Topology::new(&before);
        let mut mesh = before.clone();
        let made = mesh.split_interface(1, 2).unwrap();
        // The interface nodes: 2 rows of 3, without the row that region 3 shares with both.
        assert_eq!(made.len(), 6);
        let left = |a: f64, b: f64| nodes_of(&mesh, a).intersection(&nodes_of(&mesh, b)).count();
        assert_eq!(left(1.0, 2.0), 3);
        // Region 3 stays connected to both.
        let both = |a: f64, b: f64| nodes_of(&mesh, a).intersection(&nodes_of(&mesh, b)).count();
        assert_eq!((both(1.0, 3.0), both(2.0, 3.0)), (9, 9));
        for (a, b) in mesh.tets.iter().zip(&before.tets) {
            assert_eq!(
                a.map(|v| mesh.nodes[v as usize]),
                b.map(|v| before.nodes[v as usize])
            );
        }
        assert_eq!(mesh.nodes.len(), before.nodes.len() + 6);
        let place = mesh.field("place", Location::Node).unwrap();
        let same = |(p, xy): (&DVec3, &[f64])| [p.x, p.y] == xy;
        assert!(mesh.nodes.iter().zip(place.values.chunks(2)).all(same));
        // The faces between them are boundary on either side, and no others.
        let after = Topology::new(&mesh);
        let more = after.boundary.len() - topology.boundary.len();
        let of = |t: u32| before.field("label", Location::Cell).unwrap().values[t as usize];
        let parted = |a: u32, b: u32| [of(a), of(b)] == [1.0, 2.0] || [of(a), of(b)] == [2.0, 1.0];
        let (mut between, mut rim) = (0, 0);
        for (t, faces) in topology.neighbours.iter().enumerate() {
            for (f, n) in faces.iter().enumerate() {
                if *n == crate::mesh::NO_NEIGHBOUR || *n < 4 * t as u32 {
                    continue;
                }
                let open = after.neighbours[t][f] == crate::mesh::NO_NEIGHBOUR;
                if parted(t as u32, *n / 4) {
                    between += 1;
                    assert!(open);
                } else if open {
                    rim += 1;
                    assert!([of(t as u32), of(*n / 4)].contains(&2.0));
                }
            }
        }
        assert_eq!(between, 8);
        assert_eq!(rim, 0);
        assert_eq!(more, 2 * (between + rim));
        // No face is shared by more than two tets, and no tet is inverted.
        assert_eq!(crate::mesh::topology::crowded_faces(&mesh.tets), 0);
        assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
    }

    #[test]
    fn split_interface_splits_regions_sharing_only_an_edge() {
        let mut mesh = bar();
        // Region 2 becomes 4 except for its corner cells far from region 1.
        let label = mesh.fields.iter_mut().find(|f| f.name == "label").unwrap();
        label.values.iter_mut().for_each(|l| {
            if *l == 1.0 {
                *l = 5.0;
            }
        });
        let low = mesh.bounds().0;
        for t in 0..mesh.tets.len() {
            let p = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0 - low;
            if p.x < 2.0 && p.y > 2.0 {
                let label = mesh.fields.iter_mut().find(|f| f.name == "label").unwrap();
                label.values[t] = 6.0;
            }
        }
        // 6 lies beyond x < 2 and y > 2, 2 at x > 2 and y < 2: an edge, and others all around it.
        assert!(mesh.split_interface(6, 2).is_err());
        let label = mesh.field("label", Location::Cell).unwrap().values.clone();
        let own = |t: &usize| [2.0, 6.0].contains(&label[*t]);
        let kept: Vec<usize> = (0..mesh.tets.len()).filter(own).collect();
        let tets = kept.iter().map(|t| mesh.tets[*t]).collect();
        let label = kept.iter().map(|t| label[*t]).collect();
        let label = Field::scalar("label", Location::Cell, label);
        let mut mesh = TetMesh::new(mesh.nodes, tets, Vec::new(), Vec::new()).unwrap();
        mesh.set_field(label).unwrap();
        // Without the other regions, three nodes.
        assert_eq!(mesh.split_interface(6, 2).unwrap().len(), 3);
        assert!(nodes_of(&mesh, 6.0).is_disjoint(&nodes_of(&mesh, 2.0)));
    }

    #[test]
    fn split_interface_reports_regions_without_contact() {
        let mut mesh = bar();
        let pairs = |a: &str, b: &str| [[a.to_owned(), b.to_owned()]];
        mesh.split_interfaces(&pairs("Thigh", "2")).unwrap();
        let again = mesh
            .split_interfaces(&pairs("1", "shin"))
            .unwrap_err()
            .to_string();
        assert!(
            again.contains("\"thigh\" (1) and \"shin\" (2) share no nodes"),
            "{again}"
        );
        let unknown = mesh
            .split_interfaces(&pairs("foot", "shin"))
            .unwrap_err()
            .to_string();
        assert!(
            unknown.contains("\"foot\"; available regions: thigh, shin"),
            "{unknown}"
        );
        mesh.fields.clear();
        assert!(mesh.split_interface(1, 2).is_err());
    }

    #[test]
    fn open_interface_gap_separates_both_sides() {
        let mut mesh = bar();
        let doubles = mesh.split_interface(1, 2).unwrap();
        let volume = mesh.volume();
        let before = mesh.nodes.clone();
        assert!(mesh.open_interface_gap(&doubles, 1e3).is_err() && mesh.nodes == before);
        assert!(mesh.open_interface_gap(&doubles, f64::NAN).is_err());
        mesh.open_interface_gap(&doubles, 0.02).unwrap();
        for [v, from] in &doubles {
            let distance = mesh.nodes[*v as usize] - mesh.nodes[*from as usize];
            assert!(
                distance
                    .distance(0.02 * DVec3::NEG_X)
                    .min(distance.distance(0.02 * DVec3::X))
                    < 1e-12
            );
        }
        assert!(mesh.volume() < volume);
    }
}
