//! Approximate normals of a grid body, for shading its surface.

use super::body::CpuGridBody;
use crate::parallel;
use crate::physics::cpu::scalar::Real;
use glam::DVec3;

/// As `physics::grid::shape::MIN_NORMAL_LENGTH`: if the sum of the springs' unit vectors at a node
/// is shorter than this, the node has no outward direction.
const MIN_NORMAL_LENGTH: f64 = 0.5;

impl<T: Real> CpuGridBody<T> {
    /// Returns the unit normal of every particle, normalize(Σ_j normalize(x_i − x_j)) over its
    /// springs; zero where that sum nearly vanishes: inside, where the body is one particle thin,
    /// and for missing particles.
    pub fn normals(&self) -> Vec<DVec3> {
        parallel::map(self.rest.len(), |i| {
            let sum = self.outward_sum(i);
            match sum.length() >= MIN_NORMAL_LENGTH {
                true => sum.normalize_or_zero(),
                false => DVec3::ZERO,
            }
        })
    }

    /// Σ_j normalize(x_i − x_j).
    fn outward_sum(&self, i: usize) -> DVec3 {
        let mut sum = DVec3::ZERO;
        let springs = self.springs[i];
        for (k, kind) in self.kinds.iter().enumerate() {
            for (bit, sign) in [(2 * k, 1), (2 * k + 1, -1)] {
                if springs >> bit & 1 == 1 {
                    let j = i.wrapping_add_signed(sign * kind.offset);
                    let u = self.displacement(&self.now, i) - self.displacement(&self.now, j);
                    sum += (self.rest[i] - self.rest[j] + u).normalize_or_zero();
                }
            }
        }
        sum
    }
}
