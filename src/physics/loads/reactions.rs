//! Reaction of a body on its supports.

use super::grab::GrabMode;
use glam::DVec3;

/// The constraint of one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrabbedNode {
    /// The node, of the body's mesh.
    pub node: u32,
    /// Its constrained or target position, in file units.
    pub place: DVec3,
    /// The kind of constraint; for springs the node's share of their stiffness and limit.
    pub grip: GrabMode,
}

/// A force and its moment about the origin of the file's coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// N.
    pub force: DVec3,
    /// N·m.
    pub moment: DVec3,
}

impl Reaction {
    /// Sums forces (N) at points (m from the origin of the file's coordinates).
    pub fn from_point_forces(forces: impl IntoIterator<Item = (DVec3, DVec3)>) -> Reaction {
        let mut sum = Reaction::default();
        for (force, at) in forces {
            sum.force += force;
            sum.moment += at.cross(force);
        }
        sum
    }
}
