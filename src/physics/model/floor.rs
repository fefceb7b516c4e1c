//! A penalty floor; the float64 reference of `shaders/terms/floor.wgsl`.

use super::node_term::NodeTerm;
use crate::mesh::LocalFrame;
use crate::physics::LocalUnits;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// A plane that pushes back every node below it, by the penalty energy E = ½ m ω² d² of a node of
/// mass m at depth d.
///
/// A body of height H penetrates by about g/ω² times H over the height of the part that touches the
/// floor; an explicit step must be less than 2/ω.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Unit normal, pointing out of the floor.
    normal: DVec3,
    /// n · x on the surface, m from the frame's origin.
    offset: f64,
    /// Angular frequency ω, 1/s.
    angular_frequency: f64,
}

impl Floor {
    /// Default angular frequency ω, 1/s.
    pub const DEFAULT_RATE: f64 = 1000.0;

    /// The floor through `point` (m from the frame's origin) that pushes along `normal`, with the
    /// penalty stiffness that makes a node oscillate at the angular frequency `rate` (1/s).
    ///
    /// # Errors
    /// [`Error::Input`] if a number is out of range or not finite.
    pub fn new(point: DVec3, normal: DVec3, rate: f64) -> Result<Floor> {
        let unit = normal.normalize_or_zero();
        if unit == DVec3::ZERO || !point.is_finite() || !(rate.is_finite() && rate > 0.0) {
            return Err(Error::Input(format!(
                "invalid floor: point {point}, normal {normal}, rate {rate} 1/s; give a finite point, a non-zero normal and a rate > 0"
            )));
        }
        Ok(Floor {
            normal: unit,
            offset: unit.dot(point),
            angular_frequency: rate,
        })
    }

    fn penetration(&self, x: DVec3) -> f64 {
        self.offset - self.normal.dot(x)
    }
}

impl NodeTerm for Floor {
    fn name(&self) -> &'static str {
        "floor"
    }

    fn shader_parameters(
        &self,
        frame: &LocalFrame,
        units: &LocalUnits,
        length_unit: f64,
    ) -> [[f32; 4]; 2] {
        let offset = self.offset / (frame.scale * length_unit);
        let rate = self.angular_frequency * units.time;
        [
            self.normal.as_vec3().extend(offset as f32).to_array(),
            [(rate * rate) as f32, 0.0, 0.0, 0.0],
        ]
    }

    fn energy(&self, m: f64, x: DVec3) -> f64 {
        0.5 * self.max_stiffness(m) * self.penetration(x).max(0.0).powi(2)
    }

    fn force(&self, m: f64, x: DVec3) -> DVec3 {
        self.max_stiffness(m) * self.penetration(x).max(0.0) * self.normal
    }

    fn hessian(&self, m: f64, x: DVec3) -> DMat3 {
        if self.penetration(x) <= 0.0 {
            return DMat3::ZERO;
        }
        let n = self.normal;
        self.max_stiffness(m) * DMat3::from_cols(n * n.x, n * n.y, n * n.z)
    }

    fn max_stiffness(&self, m: f64) -> f64 {
        m * self.angular_frequency * self.angular_frequency
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn floor_force_and_hessian_are_energy_derivatives() {
        let floor =
            Floor::new(DVec3::new(0.1, 0.2, 0.3), DVec3::new(1.0, 2.0, -2.0), 30.0).unwrap();
        let (m, h) = (0.7, 1e-5);
        for x in [DVec3::new(-0.5, 0.1, 0.9), DVec3::new(2.0, 2.0, -1.0)] {
            for axis in DVec3::AXES {
                let [a, b] = [x - h * axis, x + h * axis];
                let slope = (floor.energy(m, b) - floor.energy(m, a)) / (2.0 * h);
                assert!((floor.force(m, x).dot(axis) + slope).abs() < 1e-6);
                let change = (floor.force(m, b) - floor.force(m, a)) / (2.0 * h);
                assert!((floor.hessian(m, x) * axis + change).length() < 1e-6);
            }
        }
        assert!(floor.energy(m, DVec3::new(-0.5, 0.1, 0.9)) > 0.0);
        assert_eq!(floor.energy(m, DVec3::new(2.0, 2.0, -1.0)), 0.0);
        assert!(Floor::new(DVec3::ZERO, DVec3::ZERO, 1.0).is_err());
    }
}
