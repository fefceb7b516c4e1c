//! Bitwise exact positions of a body, without velocities.

use super::{CpuBody, ForceStatus};
use crate::physics::cpu::scalar::Real;
use crate::{Error, Result};

impl<T: Real> CpuBody<T> {
    /// Returns the displacements of the nodes from rest, in local units and the engine's order;
    /// then three rows per rigid body: its translation, and the four components of its rotation.
    pub fn displacements(&self) -> Vec<[f64; 3]> {
        let own = |u: &[T; 4]| [u[0], u[1], u[2]].map(Real::to_f64);
        let rigid = self.newton.as_ref().map(|n| n.rigid.now.as_slice());
        let poses = rigid.unwrap_or_default().iter().flat_map(|pose| {
            let [a, b, c, x, y, z, w] = pose.to_array();
            [[a, b, c], [x, y, z], [w, 0.0, 0.0]]
        });
        self.state.u.iter().map(own).chain(poses).collect()
    }

    /// Restores displacements from [`CpuBody::displacements`]. Schemes restart.
    ///
    /// # Errors
    /// [`Error::Input`] for those of another body.
    pub fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()> {
        let bodies = self.newton.as_ref().map_or(0, |n| n.rigid.bodies.len());
        let slots = self.state.u.len();
        if displacements.len() != slots + 3 * bodies {
            return Err(Error::Input(format!(
                "the saved positions are of {} nodes, but the body has {}",
                displacements.len(),
                self.node_count()
            )));
        }
        for (u, [x, y, z]) in self.state.u.iter_mut().zip(displacements) {
            *u = [*x, *y, *z, 0.0].map(T::from_f64);
        }
        if let Some(newton) = &mut self.newton {
            let poses = displacements[slots..].as_chunks::<3>().0;
            for (pose, [[a, b, c], [x, y, z], [w, ..]]) in newton.rigid.now.iter_mut().zip(poses) {
                *pose = crate::physics::cpu::rigid::pose::Pose::from_array([
                    *a, *b, *c, *x, *y, *z, *w,
                ]);
            }
        }
        self.invalidate(ForceStatus::Restart);
        Ok(())
    }
}
