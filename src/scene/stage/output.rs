//! Positions and fields of a stage's body: read back, written to a series, or set.

use super::{NodeSource, Stage};
use crate::Result;
use crate::io::PvdSeries;
use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::scene::computed_field;
use glam::DVec3;

impl Stage {
    /// Sets the node positions, in file units.
    ///
    /// # Errors
    /// As [`NodePositions::set_positions`](crate::physics::NodePositions::set_positions).
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        match &mut self.drive {
            NodeSource::Posed(posed) => posed.nodes.set_positions(positions),
            NodeSource::Simulated(motion) => motion.simulator.set_positions(positions),
        }
    }

    /// Returns the mesh in its current configuration with its fields, `displacement` and `velocity`
    /// (both in file units) at the nodes, and the fields of `[output] fields`.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn deformed_mesh(&self) -> Result<TetMesh> {
        let positions = self.positions()?;
        let mut mesh = self.mesh().clone();
        for field in self.motion_fields(&positions)? {
            mesh.set_field(field)?;
        }
        mesh.nodes = positions;
        Ok(mesh)
    }

    /// Writes the current state to a series, with its fields, `displacement` and `velocity`, and
    /// the fields of `[output] fields`.
    ///
    /// # Errors
    /// An error of the read-back or of writing.
    pub fn write_frame(&self, series: &mut PvdSeries) -> Result<()> {
        let positions = self.positions()?;
        let fields = self.motion_fields(&positions)?;
        series.push_deformed(self.time(), self.mesh(), &positions, &fields)
    }

    /// Returns the node positions of the last picture, in file units. For a body on the CPU this
    /// does not wait for a running step; otherwise the positions are read back.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn drawn_positions(&self) -> Result<Vec<DVec3>> {
        self.drive.nodes().positions()
    }

    /// Reads back the node positions, in file units.
    pub(super) fn positions(&self) -> Result<Vec<DVec3>> {
        match &self.drive {
            NodeSource::Posed(posed) => posed.nodes.positions(),
            NodeSource::Simulated(motion) => motion.positions(),
        }
    }

    fn motion_fields(&self, positions: &[DVec3]) -> Result<Vec<Field>> {
        let displacements = positions
            .iter()
            .zip(&self.mesh().nodes)
            .map(|(x, rest)| *x - *rest);
        let mut fields = vec![vector_field("displacement", displacements)];
        if let Some(motion) = self.motion() {
            let velocities = motion.simulator.velocities()?;
            fields.push(vector_field("velocity", velocities.into_iter()));
            fields.extend(computed_field::output_fields(&self.scene, motion)?);
        }
        Ok(fields)
    }
}

fn vector_field(name: &str, vectors: impl Iterator<Item = DVec3>) -> Field {
    Field {
        name: name.into(),
        location: Location::Node,
        components: 3,
        values: vectors.flat_map(|v| v.to_array()).collect(),
        scalar_type: ScalarType::F32,
    }
}
