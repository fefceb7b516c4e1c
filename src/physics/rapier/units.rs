//! The units that rapier computes in: its tolerances are absolute, and meant for cells of about one.

use crate::physics::DiscreteModel;
use glam::{DQuat, DVec3};
use rapier3d::math::{Pose, Rotation, Vector};

/// Metres and kilograms in a unit of rapier's world; time is in seconds.
///
/// A tet smaller than 10⁻⁷ units³ is nothing to rapier, so a unit is the mean edge of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// m.
    pub length: f64,
    /// kg.
    pub mass: f64,
}

impl Scale {
    /// The units that suit `network`: its mean edge and mean nodal mass.
    pub fn from_model(network: &DiscreteModel) -> Scale {
        let edges = network.springs.iter().map(|s| s.length);
        let extent = network.frame.scale * network.length_unit;
        Scale {
            length: mean(edges).unwrap_or(0.1 * extent),
            mass: mean(network.masses.iter().copied()).unwrap_or(1.0),
        }
    }

    /// A place (m), a velocity (m/s) or an acceleration (m/s²).
    pub fn vector(&self, metres: DVec3) -> Vector {
        let [x, y, z] = (metres / self.length).as_vec3().to_array();
        Vector::new(x, y, z)
    }

    /// The same back.
    pub fn metres(&self, v: Vector) -> DVec3 {
        self.length * DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
    }

    /// A force, N.
    pub fn force(&self, newtons: DVec3) -> Vector {
        self.vector(newtons / self.mass)
    }

    /// A stress, Pa.
    pub fn stress(&self, pascals: f64) -> f32 {
        (pascals * self.length / self.mass) as f32
    }

    /// A place (m) and a turn.
    pub fn pose(&self, place: DVec3, turn: DQuat) -> Pose {
        let [x, y, z, w] = turn.normalize().as_quat().to_array();
        Pose::from_parts(self.vector(place), Rotation::from_xyzw(x, y, z, w))
    }
}

/// The mean of the positive values, if there are any.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values
        .filter(|v| *v > 0.0)
        .fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}
