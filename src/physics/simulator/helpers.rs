//! What is said of a simulator in one line where the trait takes several.

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
    /// how many they are.
    ///
    /// # Errors
    /// As [`Simulator::pin_nodes`].
    pub fn pin(&mut self, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let nodes = self.nodes_where(where_);
        self.pin_nodes(&nodes)?;
        Ok(nodes.len())
    }

    /// Adds `force` (N in all) in equal shares to the nodes whose rest position, in file units,
    /// satisfies `where_`. Returns how many they are.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) when the force is not finite or there are no such
    /// nodes.
    pub fn add_force(&mut self, force: DVec3, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let nodes = self.nodes_where(where_);
        self.loads_mut().add_force(force, &nodes)?;
        Ok(nodes.len())
    }

    /// Holds the body by the end that suits it ([`ClampedEnd::of_largest_component`]) and lets `gravity` (m/s²)
    /// act across it. Returns a sentence that says so.
    ///
    /// # Errors
    /// As [`Simulator::pin_nodes`].
    pub fn clamp_one_end(&mut self, gravity: f64) -> Result<String> {
        let (rest, springs) = (&self.mesh().nodes, self.spring_pairs().into_iter());
        let (end, _) = ClampedEnd::of_largest_component(rest, self.masses(), springs, DVec3::NEG_Z);
        self.pin_nodes(&end.nodes)?;
        self.loads_mut().set_gravity(gravity * end.load_direction());
        let along = if end.axis == 2 { "-y" } else { "-z" };
        Ok(format!(
            "held {end}; gravity of {gravity} m/s² acts along {along}"
        ))
    }

    /// Brings [`Simulator::nodes`] to where the body is, at once.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn sync_nodes(&mut self) -> Result<()> {
        let gpu = self.nodes().gpu().clone();
        let mut work = gpu.start_recording();
        self.update_nodes(&mut work)?;
        work.submit()
    }
}
