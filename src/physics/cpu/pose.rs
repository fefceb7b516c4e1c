//! Where a body stands, to the bit, without how it moves.

use super::body::{CpuBody, Start};
use super::real::Real;
use crate::{Error, Result};

impl<T: Real> CpuBody<T> {
    /// Displacements of the nodes from their rest, in local units and the engine's order.
    pub fn displacements(&self) -> Vec<[f64; 3]> {
        let own = |u: &[T; 4]| [u[0], u[1], u[2]].map(Real::wide);
        self.now.u.iter().map(own).collect()
    }

    /// Puts the nodes where [`CpuBody::displacements`] found them. Schemes begin afresh.
    ///
    /// # Errors
    /// [`Error::Input`] for those of another body.
    pub fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()> {
        if displacements.len() != self.node_count() {
            return Err(Error::Input(format!(
                "the pose of {} nodes does not fit a body of {}",
                displacements.len(),
                self.node_count()
            )));
        }
        for (u, [x, y, z]) in self.now.u.iter_mut().zip(displacements) {
            *u = [*x, *y, *z, 0.0].map(T::of);
        }
        self.changed(Start::Restart);
        Ok(())
    }
}
