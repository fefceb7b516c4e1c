//! Forces inside a body.

use crate::Result;
use crate::physics::Reaction;
use glam::DVec3;

/// Forces on the nodes and the rigid regions of a body.
pub trait Reactions {
    /// Returns the force on every node of the mesh in the present configuration, N: of the
    /// material, damping, node terms and loads, without constraint forces; on constrained nodes it
    /// is therefore the force on the support. NaN on nodes of rigid regions, where only the sum is
    /// known. Waits for requested steps.
    ///
    /// # Errors
    /// As [`Simulator::finish`](crate::physics::Simulator::finish).
    fn nodal_forces(&mut self) -> Result<Vec<DVec3>>;

    /// Returns the force that the rest of the body exerts on the rigid region with this label in
    /// the present configuration, N, by contact and by the soft tissue around it, and its moment
    /// about the region's centre of mass, N·m. `None` if there is no such region. Waits for
    /// requested steps.
    ///
    /// # Errors
    /// As [`Simulator::finish`](crate::physics::Simulator::finish).
    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>>;
}
