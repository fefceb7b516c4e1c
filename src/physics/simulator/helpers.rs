//! Convenience methods of [`Simulator`] trait objects.

use crate::Result;
use crate::physics::{ClampedEnd, Simulator};
use glam::DVec3;

impl dyn Simulator + '_ {
    /// The nodes of the mesh whose rest position, in file units, satisfies `where_`.
    pub fn nodes_where(&self, where_: impl Fn(DVec3) -> bool) -> Vec<u32> {
        let nodes = (0u32..).zip(&self.mesh().nodes);
        nodes.filter(|n| where_(*n.1)).map(|n| n.0).collect()
    }

    /// Pins every node of the mesh whose rest position, in file units, satisfies `where_`. Returns
    /// the number of these nodes.
    ///
    /// # Errors
    /// As [`Simulator::pin_nodes`].
    pub fn pin(&mut self, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let nodes = self.nodes_where(where_);
        self.pin_nodes(&nodes)?;
        Ok(nodes.len())
    }

    /// Distributes the total `force` (N) equally over the nodes whose rest position, in file units,
    /// satisfies `where_`. Returns their number.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the force is not finite or there are no such nodes.
    pub fn add_force(&mut self, force: DVec3, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let nodes = self.nodes_where(where_);
        self.loads_mut().add_force(force, &nodes)?;
        Ok(nodes.len())
    }

    /// Clamps the end chosen by `ClampedEnd::of_largest_component` and applies `gravity` (m/s²)
    /// across it. Returns a sentence that describes both.
    ///
    /// # Errors
    /// As [`Simulator::pin_nodes`].
    pub fn clamp_one_end(&mut self, gravity: f64) -> Result<String> {
        let (rest, edges) = (&self.mesh().nodes, self.edge_nodes().into_iter());
        let (end, _) = ClampedEnd::of_largest_component(rest, self.masses(), edges, DVec3::NEG_Z);
        self.pin_nodes(&end.nodes)?;
        self.loads_mut().set_gravity(gravity * end.load_direction());
        let along = if end.axis == 2 { "-y" } else { "-z" };
        Ok(format!(
            "clamped {end}; gravity of {gravity} m/s² acts along {along}"
        ))
    }

    /// Updates [`Simulator::nodes`] to the present configuration at once.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    pub fn sync_nodes(&mut self) -> Result<()> {
        let gpu = self.nodes().gpu().clone();
        let mut work = gpu.start_recording();
        self.update_nodes(&mut work)?;
        work.submit()
    }
}
