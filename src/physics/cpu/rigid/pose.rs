//! A single rigid body: its proxy nodes, degrees of freedom and pose.

use super::closest_rotation::closest_rotation;
use crate::physics::cpu::vectors::outer;
pub(in crate::physics::cpu) use crate::physics::model::rigid_region::DegreesOfFreedom;
use crate::physics::model::rigid_region::MassProperties;
use glam::{DMat3, DQuat, DVec3};
use std::ops::Range;

/// Number of proxy nodes of a body.
pub(in crate::physics::cpu) const PROXY_NODES: usize = 4;

/// Positions of the proxy nodes: the corners of a regular tetrahedron.
pub(in crate::physics::cpu) const PROXY_POSITIONS: [DVec3; PROXY_NODES] = [
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, -1.0, -1.0),
    DVec3::new(-1.0, 1.0, -1.0),
    DVec3::new(-1.0, -1.0, 1.0),
];

/// Pose of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::physics::cpu) struct Pose {
    /// Displacement of its centre from rest.
    pub translation: DVec3,
    /// Rotation.
    pub rotation: DQuat,
}

impl Pose {
    pub const REST: Pose = Pose {
        translation: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
    };

    /// Interpolates a fraction of the way to another pose.
    pub fn interpolate(&self, other: &Pose, share: f64) -> Pose {
        Pose {
            translation: self.translation.lerp(other.translation, share),
            rotation: self.rotation.slerp(other.rotation, share),
        }
    }

    /// Returns the bitwise exact components.
    pub fn to_array(self) -> [f64; 7] {
        let ([a, b, c], [x, y, z, w]) = (self.translation.to_array(), self.rotation.to_array());
        [a, b, c, x, y, z, w]
    }

    /// Inverse of [`Pose::to_array`].
    pub fn from_array([a, b, c, x, y, z, w]: [f64; 7]) -> Pose {
        Pose {
            translation: DVec3::new(a, b, c),
            rotation: DQuat::from_array([x, y, z, w]),
        }
    }
}

/// A rigid body. Lengths and masses in local units.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct RigidGroup {
    /// Its nodes in the plan: those of the surface, then the proxy nodes.
    pub nodes: Range<usize>,
    /// Its interior nodes, beyond the plan.
    pub inner: Range<usize>,
    /// Its centre of mass at rest.
    pub centre: DVec3,
    pub mass: f64,
    /// A, and A⁻¹.
    pub inertia_map: DMat3,
    pub inverse_inertia_map: DMat3,
    pub freedom: DegreesOfFreedom,
    /// Whether no soft tissue is attached.
    pub is_isolated: bool,
}

impl RigidGroup {
    /// Returns the length scale: the radius of gyration.
    pub fn radius(&self) -> f64 {
        let a = self.inertia_map;
        (a.x_axis.length_squared() + a.y_axis.length_squared() + a.z_axis.length_squared()).sqrt()
    }

    /// Returns the slots of the proxy nodes.
    pub fn proxy_nodes(&self) -> Range<usize> {
        self.nodes.end - PROXY_NODES..self.nodes.end
    }

    /// Returns the pivot, relative to its centre at rest, and the projector onto its permitted
    /// rotations in `pose`.
    pub fn pivot(&self, pose: &Pose) -> (DVec3, DMat3) {
        match self.freedom {
            DegreesOfFreedom::Free => (DVec3::ZERO, DMat3::IDENTITY),
            DegreesOfFreedom::Rotational(at, None) => (at, DMat3::IDENTITY),
            DegreesOfFreedom::Rotational(at, Some(axis)) => {
                (at, outer(pose.rotation * axis, pose.rotation * axis))
            }
            DegreesOfFreedom::Fixed => (DVec3::ZERO, DMat3::ZERO),
        }
    }

    /// Returns the pose after a rotation by the rotation vector `by` about its pivot and a
    /// translation.
    pub fn displaced(&self, from: &Pose, shift: DVec3, by: DVec3) -> Pose {
        let (pivot, _) = self.pivot(from);
        let turn = (DQuat::from_scaled_axis(by) * from.rotation).normalize();
        Pose {
            translation: from.translation + shift + (from.rotation * pivot - turn * pivot),
            rotation: turn,
        }
    }

    /// Returns the permitted pose that brings its proxy nodes closest to `targets`.
    pub fn closest_pose(&self, from: &Pose, targets: [DVec3; PROXY_NODES]) -> Pose {
        let arms = PROXY_POSITIONS.map(|t| self.inertia_map * t);
        let (pivot, within) = self.pivot(from);
        let (at, free) = match self.freedom {
            DegreesOfFreedom::Fixed => return *from,
            DegreesOfFreedom::Free => (targets.iter().sum::<DVec3>() / PROXY_NODES as f64, true),
            DegreesOfFreedom::Rotational(..) => (
                self.centre + from.translation + from.rotation * pivot,
                false,
            ),
        };
        let mut m = DMat3::ZERO;
        for (x, r) in targets.iter().zip(arms) {
            m += outer(*x - at, r - pivot);
        }
        let turn = closest_rotation(&m, from.rotation, within);
        Pose {
            translation: match free {
                true => at - self.centre,
                false => from.translation + (from.rotation * pivot - turn * pivot),
            },
            rotation: turn,
        }
    }
}

/// Returns the proxy nodes of a body: their positions relative to its centre, and A.
pub(in crate::physics::cpu) fn carriers(moments: &MassProperties) -> ([DVec3; PROXY_NODES], DMat3) {
    let (values, vectors) = moments.principal;
    let column = |k: usize| vectors[k] * (values[k] / moments.mass).sqrt();
    let spread = DMat3::from_cols(column(0), column(1), column(2));
    (PROXY_POSITIONS.map(|t| spread * t), spread)
}

/// Returns |a|² I − a aᵀ.
pub(in crate::physics::cpu) fn inertia_of(a: DVec3) -> DMat3 {
    DMat3::from_diagonal(DVec3::splat(a.length_squared())) - outer(a, a)
}

/// Returns the permitted rotation vector that `moment` gives a body with this inertia.
pub(in crate::physics::cpu) fn rotation_response(
    inertia: DMat3,
    moment: DVec3,
    within: DMat3,
) -> DVec3 {
    let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    let whole = within * inertia * within + (DMat3::IDENTITY - within) * trace;
    within * (whole.inverse() * (within * moment))
}
