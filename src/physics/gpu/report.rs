//! The report on a body on the GPU.

use crate::Result;
use crate::mesh::TetMesh;
use crate::physics::{Energy, GpuBody, Report};

impl Report {
    /// The report on `body`, which is made of `mesh`.
    ///
    /// # Errors
    /// Errors of reading back.
    pub fn new(body: &GpuBody, mesh: &TetMesh) -> Result<Report> {
        let positions = body.positions()?;
        let velocities = body.velocities()?;
        let energy = Energy::from_state(body.model(), body.terms(), &positions, &velocities);
        Ok(Report::from_positions(energy, mesh, &positions))
    }
}
