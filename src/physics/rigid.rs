//! Regions that move as one body: which nodes of a mesh they are.

use crate::mesh::{FACES, TetMesh};
use std::collections::{BTreeMap, BTreeSet};

/// A rigid body of a mesh: rigid tets that hang together by their nodes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RigidBody {
    /// All of its nodes, ascending.
    pub nodes: Vec<u32>,
    /// Those on its surface, ascending: where it meets what is soft, or nothing. The others are
    /// of no account for what happens around it.
    pub surface: Vec<u32>,
    /// The labels of the regions it is made of.
    pub labels: BTreeSet<i64>,
}

/// The rigid bodies of `mesh`, `label` being the region of a tet if that is rigid. Rigid tets that
/// share a node are one body, whatever their regions: there is no joint in a point.
pub(super) fn rigid_bodies(mesh: &TetMesh, label: impl Fn(usize) -> Option<i64>) -> Vec<RigidBody> {
    const NONE: u32 = u32::MAX;
    let rigid: Vec<(usize, i64)> = (0..mesh.tets.len())
        .filter_map(|t| Some((t, label(t)?)))
        .collect();
    if rigid.is_empty() {
        return Vec::new();
    }
    let mut parent = vec![NONE; mesh.nodes.len()];
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for (t, _) in &rigid {
        let tet = mesh.tets[*t];
        for v in tet {
            if parent[v as usize] == NONE {
                parent[v as usize] = v;
            }
        }
        for v in &tet[1..] {
            let (a, b) = (root(&mut parent, tet[0]), root(&mut parent, *v));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut bodies: BTreeMap<u32, RigidBody> = BTreeMap::new();
    for v in 0..mesh.nodes.len() as u32 {
        if parent[v as usize] != NONE {
            let body = bodies.entry(root(&mut parent, v)).or_default();
            body.nodes.push(v);
        }
    }
    let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * rigid.len());
    for (t, label) in &rigid {
        let tet = mesh.tets[*t];
        let body = root(&mut parent, tet[0]);
        if let Some(body) = bodies.get_mut(&body) {
            body.labels.insert(*label);
        }
        for face in FACES {
            let mut key = face.map(|i| tet[i]);
            key.sort_unstable();
            faces.push((key, body));
        }
    }
    faces.sort_unstable();
    for same in faces.chunk_by(|a, b| a.0 == b.0) {
        if let ([(face, body)], true) = (same, same.len() == 1)
            && let Some(body) = bodies.get_mut(body)
        {
            body.surface.extend(face);
        }
    }
    let mut bodies: Vec<RigidBody> = bodies.into_values().collect();
    for body in &mut bodies {
        body.surface.sort_unstable();
        body.surface.dedup();
    }
    bodies
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::mesh::generate;

    #[test]
    fn bodies_are_what_hangs_together() {
        let mesh = generate::bar([6, 3, 3], glam::DVec3::new(6.0, 3.0, 3.0)).unwrap();
        let middle = |t: usize| mesh.tet_nodes(t).iter().sum::<glam::DVec3>() / 4.0;
        let low = mesh.bounds().0;
        // Two ends, one of two regions.
        let label = |t: usize| {
            let p = middle(t) - low;
            match p.x {
                x if x < 1.0 => Some(1),
                x if x > 4.0 => Some(if p.y < 1.0 { 2 } else { 3 }),
                _ => None,
            }
        };
        let bodies = rigid_bodies(&mesh, label);
        let nodes: Vec<usize> = bodies.iter().map(|b| b.nodes.len()).collect();
        assert_eq!(nodes, [32, 48]);
        // Inside the second lie the four nodes of its middle layer.
        let inside: Vec<usize> = bodies
            .iter()
            .map(|b| b.nodes.len() - b.surface.len())
            .collect();
        assert_eq!(inside, [0, 4]);
        assert_eq!(bodies[0].labels, BTreeSet::from([1]));
        assert_eq!(bodies[1].labels, BTreeSet::from([2, 3]));
        assert!(rigid_bodies(&mesh, |_| None).is_empty());
    }
}
