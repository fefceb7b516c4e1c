//! The units of rapier's worlds: rapier's tolerances are absolute and tuned for cells of about unit
//! size.

use crate::physics::DiscreteModel;
use glam::{DQuat, DVec3};
use rapier3d::math::{Pose, Rotation, Vector};

/// Metres and kilograms per unit of rapier's world; time is in seconds.
///
/// rapier treats a tet smaller than 10⁻⁷ units³ as degenerate, so the length unit is the mean edge
/// of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// Metres per unit of length.
    pub length: f64,
    /// Kilograms per unit of mass.
    pub mass: f64,
}

impl Scale {
    /// Units derived from the mean edge length and the mean nodal mass of `model`.
    pub fn from_model(model: &DiscreteModel) -> Scale {
        let edges = model.edges.iter().map(|e| e.length);
        let extent = model.frame.scale * model.length_unit;
        Scale {
            length: mean(edges).unwrap_or(0.1 * extent),
            mass: mean(model.masses.iter().copied()).unwrap_or(1.0),
        }
    }

    /// Converts a position (m), velocity (m/s) or acceleration (m/s²).
    pub fn vector(&self, metres: DVec3) -> Vector {
        let [x, y, z] = (metres / self.length).as_vec3().to_array();
        Vector::new(x, y, z)
    }

    /// Converts back to metres.
    pub fn metres(&self, v: Vector) -> DVec3 {
        self.length * DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
    }

    /// Converts a force, N.
    pub fn force(&self, newtons: DVec3) -> Vector {
        self.vector(newtons / self.mass)
    }

    /// Converts a stress, Pa.
    pub fn stress(&self, pascals: f64) -> f32 {
        (pascals * self.length / self.mass) as f32
    }

    /// Converts a position (m) and a rotation to a pose.
    pub fn pose(&self, place: DVec3, turn: DQuat) -> Pose {
        let [x, y, z, w] = turn.normalize().as_quat().to_array();
        Pose::from_parts(self.vector(place), Rotation::from_xyzw(x, y, z, w))
    }
}

/// The mean of the positive values; `None` if there are none.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values
        .filter(|v| *v > 0.0)
        .fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}
