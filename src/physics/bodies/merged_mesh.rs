//! The combined mesh of several bodies, and the mapping of their cuts to its numbering.

use crate::Result;
use crate::mesh::{BoundaryFace, Location, NO_NEIGHBOUR, TetCut, TetMesh, Topology};
use crate::physics::TopologyChange;

/// A combined mesh, and the map from each body's nodes to it.
///
/// Tets are ordered by body; nodes duplicated by cuts follow the nodes of all bodies.
pub(super) struct MergedMesh {
    pub mesh: TetMesh,
    pub topology: Topology,
    /// For each body, the number of each of its nodes in the combined mesh.
    pub node_map: Vec<Vec<u32>>,
    /// The body and its own region for each label of the combined mesh, from 1.
    regions: Vec<(usize, Option<i64>)>,
}

/// A body's mesh and topology.
pub(super) type MeshRef<'a> = (&'a TetMesh, &'a Topology);

impl MergedMesh {
    /// Combines the meshes of `parts`, given by name.
    pub fn new(parts: &[(String, &TetMesh)]) -> Result<MergedMesh> {
        let mesh = TetMesh::merge_meshes(parts)?;
        let mut first = 0;
        let places = parts.iter().map(|(_, part)| {
            let nodes = part.nodes.len() as u32;
            first += nodes;
            (first - nodes..first).collect()
        });
        Ok(MergedMesh {
            node_map: places.collect(),
            topology: Topology::new(&mesh),
            regions: TetMesh::merged_regions(parts),
            mesh,
        })
    }

    /// Returns the body and its own label of the region with this label in the combined mesh.
    pub fn region(&self, label: i64) -> Option<(usize, i64)> {
        let index = usize::try_from(label).ok()?.checked_sub(1)?;
        let (body, region) = self.regions.get(index)?;
        Some((*body, (*region)?))
    }

    /// Applies one cut for each body; `parts` are the bodies' meshes after these cuts.
    pub fn follow(&mut self, changes: &[TopologyChange], parts: &[MeshRef]) -> TetCut {
        let mut whole = TetCut::default();
        let mut first = 0;
        for (i, (change, (mesh, _))) in changes.iter().zip(parts).enumerate() {
            let cut = &change.mesh;
            let tets = (mesh.tets.len() + cut.removed.len()) as u32;
            for [new, old] in &cut.duplicated_nodes {
                let old = self.node_map[i][*old as usize];
                whole.duplicated_nodes.push([self.duplicate_node(old), old]);
                self.node_map[i].push(self.mesh.nodes.len() as u32 - 1);
                debug_assert_eq!(*new as usize + 1, self.node_map[i].len());
            }
            add(&mut whole, cut, first, &self.node_map[i]);
            first += tets;
        }
        if !whole.removed.is_empty() {
            // As after any removal, tets are renumbered.
            let (doubled, opened, removed) =
                (whole.duplicated_nodes, whole.opened_faces, whole.removed);
            let nodes = whole.nodes;
            whole = TetCut {
                duplicated_nodes: doubled,
                opened_faces: opened,
                removed,
                nodes,
                ..TetCut::default()
            };
            self.drop_cell_values(&whole.removed);
        }
        whole.nodes.sort_unstable();
        whole.previous_edges.sort_unstable();
        whole.edge_tets.sort_unstable();
        self.rebuild(parts);
        whole
    }

    /// Adds a duplicate of node `old` and returns its number.
    fn duplicate_node(&mut self, old: u32) -> u32 {
        let new = self.mesh.nodes.len() as u32;
        self.mesh.nodes.push(self.mesh.nodes[old as usize]);
        for field in &mut self.mesh.fields {
            if field.location == Location::Node {
                let at = old as usize * field.components;
                field.values.extend_from_within(at..at + field.components);
            }
        }
        new
    }

    /// Drops the field values of removed tets, given in ascending order.
    fn drop_cell_values(&mut self, removed: &[u32]) {
        for field in &mut self.mesh.fields {
            if field.location == Location::Cell {
                let (mut gone, mut i) = (removed.iter().peekable(), 0);
                let mut kept = Vec::with_capacity(field.values.len());
                for tuple in field.values.chunks_exact(field.components) {
                    if gone.next_if(|t| **t == i).is_none() {
                        kept.extend_from_slice(tuple);
                    }
                    i += 1;
                }
                field.values = kept;
            }
        }
    }

    /// Rebuilds tets, topology and boundary from all parts.
    fn rebuild(&mut self, parts: &[MeshRef]) {
        let (mesh, all) = (&mut self.mesh, &mut self.topology);
        mesh.tets.clear();
        all.neighbours.clear();
        all.boundary.clear();
        for ((part, topology), places) in parts.iter().zip(&self.node_map) {
            let first = mesh.tets.len() as u32;
            let place = |v: u32| places[v as usize];
            mesh.tets.extend(part.tets.iter().map(|t| t.map(place)));
            let code = |c: u32| match c {
                NO_NEIGHBOUR => NO_NEIGHBOUR,
                c => c + 4 * first,
            };
            let codes = topology.neighbours.iter().map(|n| n.map(code));
            all.neighbours.extend(codes);
            let boundary = topology.boundary.iter();
            all.boundary.extend(boundary.map(|f| shifted(*f, first)));
        }
    }
}

/// Adds the cut of a body whose tets start at `first` to the combined cut. `places` ascends, so the
/// order of node numbers is preserved.
fn add(whole: &mut TetCut, cut: &TetCut, first: u32, places: &[u32]) {
    let place = |v: u32| places[v as usize];
    let tet = |t: &u32| t + first;
    let opened = cut.opened_faces.iter();
    whole
        .opened_faces
        .extend(opened.map(|pair| pair.map(|f| shifted(f, first))));
    whole.tets.extend(cut.tets.iter().map(tet));
    whole
        .incident_tets
        .extend(cut.incident_tets.iter().map(tet));
    whole.removed.extend(cut.removed.iter().map(tet));
    whole.nodes.extend(cut.nodes.iter().map(|v| place(*v)));
    let before = cut.previous_edges.iter();
    whole.previous_edges.extend(before.map(|e| e.map(place)));
    let around = cut.edge_tets.iter();
    whole
        .edge_tets
        .extend(around.map(|(e, t)| (e.map(place), t + first)));
}

fn shifted(face: BoundaryFace, first: u32) -> BoundaryFace {
    BoundaryFace {
        tet: face.tet + first,
        ..face
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::mesh::{Blade, cut};
    use glam::DVec3;
    use std::collections::BTreeSet;

    /// Two bars side by side, cut one after the other and both at once: equal to the same cuts of
    /// the combined mesh.
    #[test]
    fn cuts_of_members_equal_cut_of_merged_mesh() {
        let bar = generate::by_name("bar", Some(600)).unwrap();
        let (low, high) = bar.bounds();
        let away = DVec3::Y * 2.0 * (high - low).length();
        let mut second = bar.clone();
        second.nodes.iter_mut().for_each(|p| *p += away);
        let mut meshes = [bar, second];
        let mut topologies = [0, 1].map(|i| Topology::new(&meshes[i]));
        let named = |meshes: &[TetMesh; 2]| {
            let named = ["a", "b"].map(String::from);
            named.into_iter().zip(meshes.clone()).collect::<Vec<_>>()
        };
        let parts = named(&meshes);
        let parts: Vec<(String, &TetMesh)> = parts.iter().map(|(n, m)| (n.clone(), m)).collect();
        let mut whole = MergedMesh::new(&parts).unwrap();
        let (mut mesh, mut topology) = (whole.mesh.clone(), whole.topology.clone());
        let size = high - low;
        let blade = |at: f64, y: [f64; 2]| {
            let x = low.x + at * size.x;
            let reach = [low.z - size.z, high.z + size.z];
            let edge = |y: f64| reach.map(|z| DVec3::new(x, y, z));
            Blade::from_sweep(&y.map(edge)).unwrap()
        };
        let ends = [low.y - size.y, high.y + size.y];
        let both = [ends[0], ends[1] + away.y];
        let only_second = ends.map(|y| y + away.y);
        for (at, y) in [(0.3, ends), (0.6, only_second), (0.45, both)] {
            let blade = blade(at, y);
            let mut changes = Vec::new();
            for (mesh, topology) in meshes.iter_mut().zip(&mut topologies) {
                let at = mesh.nodes.clone();
                changes.push(TopologyChange {
                    mesh: cut(mesh, topology, &at, &blade).unwrap(),
                    springs: 0,
                });
            }
            let parts: Vec<MeshRef> = meshes.iter().zip(&topologies).collect();
            let mut edges: BTreeSet<[u32; 2]> = whole.mesh.edges().into_iter().collect();
            let combined = whole.follow(&changes, &parts);
            assert!(!combined.is_empty());
            let at = mesh.nodes.clone();
            let truth = cut(&mut mesh, &mut topology, &at, &blade).unwrap();
            assert_eq!(
                combined.duplicated_nodes.len(),
                truth.duplicated_nodes.len()
            );
            assert_eq!(
                (&combined.tets, &combined.incident_tets),
                (&truth.tets, &truth.incident_tets)
            );
            assert_eq!(whole.topology.neighbours, topology.neighbours);
            assert_eq!(whole.topology.boundary, topology.boundary);
            assert_eq!(whole.mesh.edges().len(), mesh.edges().len());
            assert!(
                combined
                    .previous_edges
                    .iter()
                    .all(|edge| edges.remove(edge))
            );
            edges.extend(combined.edge_tets.iter().map(|(edge, _)| *edge));
            assert_eq!(edges, whole.mesh.edges().into_iter().collect());
            assert_eq!(whole.mesh.nodes.len(), mesh.nodes.len());
            let sorted = |list: &[[u32; 2]]| list.windows(2).all(|w| w[0] <= w[1]);
            assert!(sorted(&combined.previous_edges) && combined.nodes.is_sorted());
            for [new, old] in &combined.duplicated_nodes {
                assert_eq!(
                    whole.mesh.nodes[*new as usize],
                    whole.mesh.nodes[*old as usize]
                );
            }
        }
    }
}
