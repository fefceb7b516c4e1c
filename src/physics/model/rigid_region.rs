//! Rigid regions: their nodes, inertia and degrees of freedom.

use super::elements::eigen;
use crate::mesh::{FACES, TetMesh};
use crate::physics::{DiscreteModel, LocalUnits};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// A rigid body of a mesh: rigid tets connected by shared nodes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RigidBody {
    /// All of its nodes, ascending.
    pub nodes: Vec<u32>,
    /// Its surface nodes, ascending: those on the boundary, and those shared with soft tets. The
    /// others do not affect the surroundings.
    pub surface: Vec<u32>,
    /// The labels of the regions it is made of.
    pub labels: BTreeSet<i64>,
}

/// The index of the rigid body of each of `count` nodes; `None` for soft nodes.
///
/// # Errors
/// [`Error::Input`] if a node does not exist, or belongs to two bodies.
pub(in crate::physics) fn node_owners(
    bodies: &[RigidBody],
    count: usize,
) -> Result<Vec<Option<u32>>> {
    let strange = |b: &RigidBody| {
        let mut nodes = b.nodes.iter().chain(&b.surface);
        nodes.any(|v| *v as usize >= count)
    };
    if bodies.iter().any(strange) {
        return Err(Error::Input(
            "a rigid body has nodes that do not exist in the model".into(),
        ));
    }
    let mut owner = vec![None; count];
    for (b, body) in bodies.iter().enumerate() {
        for v in &body.nodes {
            if owner[*v as usize].replace(b as u32).is_some() {
                return Err(Error::Input(format!(
                    "node {v} belongs to two rigid bodies; merge bodies that share nodes"
                )));
            }
        }
    }
    Ok(owner)
}

/// Mass properties of a rigid body, in local units.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics) struct MassProperties {
    /// Its centre of mass at rest.
    pub centre: DVec3,
    pub mass: f64,
    /// Σ m r rᵀ, r from the centre.
    pub second_moment: DMat3,
    /// Its eigenvalues and eigenvectors.
    pub principal: ([f64; 3], [DVec3; 3]),
}

impl MassProperties {
    /// Computes the properties of a body of `model`.
    ///
    /// # Errors
    /// [`Error::Input`] if the body is massless or flat.
    pub fn from_nodes(
        model: &DiscreteModel,
        body: &RigidBody,
        units: &LocalUnits,
    ) -> Result<MassProperties> {
        let nodes = || {
            body.nodes.iter().map(|v| {
                let v = *v as usize;
                (
                    model.masses[v] / units.mass,
                    model.rest_positions[v] / units.length,
                )
            })
        };
        let mass: f64 = nodes().map(|(m, _)| m).sum();
        let centre = nodes().map(|(m, x)| m * x).sum::<DVec3>() / mass;
        let mut second = DMat3::ZERO;
        for (m, x) in nodes() {
            let r = x - centre;
            second += DMat3::from_cols(r * r.x, r * r.y, r * r.z) * m;
        }
        let column = |j: usize| second.col(j);
        let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| column(j)[i]));
        let (values, vectors) = eigen(rows);
        let largest = values.iter().fold(0.0f64, |a, b| a.max(*b));
        let sound = mass > 0.0 && mass.is_finite() && largest > 0.0 && largest.is_finite();
        if !sound || values.iter().any(|v| *v < 1e-10 * largest) {
            let from = body.nodes.first().copied().unwrap_or(0);
            return Err(Error::Input(format!(
                "the rigid body of {} nodes at node {from} is flat or has no mass; rigid regions require tets with a volume, and a density",
                body.nodes.len()
            )));
        }
        Ok(MassProperties {
            centre,
            mass,
            second_moment: second,
            principal: (values, vectors.map(DVec3::from)),
        })
    }
}

/// Distance relative to the body's radius of gyration below which constrained points coincide.
const COINCIDENCE_RATIO: f64 = 1e-6;

/// The degrees of freedom of a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::physics) enum DegreesOfFreedom {
    /// Unconstrained.
    Free,
    /// Rotation about a fixed point, given relative to the centre at rest; if the second is given,
    /// about that axis only.
    Rotational(DVec3, Option<DVec3>),
    /// None: three nodes that are not collinear are constrained.
    Fixed,
}

impl DegreesOfFreedom {
    /// Returns the degrees of freedom left by constraints at the points `held`, relative to the
    /// centre at rest, for a body with the radius of gyration `radius`.
    pub fn of(held: impl Iterator<Item = DVec3>, radius: f64) -> DegreesOfFreedom {
        let near = COINCIDENCE_RATIO * radius;
        held.fold(DegreesOfFreedom::Free, |freedom, r| match freedom {
            DegreesOfFreedom::Free => DegreesOfFreedom::Rotational(r, None),
            DegreesOfFreedom::Rotational(at, None) if r.distance(at) > near => {
                DegreesOfFreedom::Rotational(at, Some((r - at).normalize()))
            }
            DegreesOfFreedom::Rotational(at, Some(axis))
                if (r - at).cross(axis).length() > near =>
            {
                DegreesOfFreedom::Fixed
            }
            same => same,
        })
    }
}

/// The rigid bodies of `mesh`; `label` returns the region of a rigid tet. Rigid tets that share a
/// node form one body, whatever their regions: one shared node is not a joint.
pub(in crate::physics) fn rigid_bodies(
    mesh: &TetMesh,
    label: impl Fn(usize) -> Option<i64>,
) -> Vec<RigidBody> {
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
    use crate::generate;

    #[test]
    fn rigid_bodies_are_connected_components() {
        let mesh = generate::bar([6, 3, 3], glam::DVec3::new(6.0, 3.0, 3.0)).unwrap();
        let middle = |t: usize| mesh.tet_nodes(t).iter().sum::<glam::DVec3>() / 4.0;
        let low = mesh.bounds().0;
        // Two rigid ends, one of two regions.
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
        // The four nodes of the middle layer are interior to the second body.
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
