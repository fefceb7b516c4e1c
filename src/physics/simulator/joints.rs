//! Joints between the rigid regions of a body.

use crate::Result;
use crate::physics::Joint;

/// Joints between the rigid regions of a body.
pub trait Joints {
    /// Adds a joint between two rigid regions, or from one to the world, in the rest configuration.
    /// Joined regions do not collide with each other.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the joint is invalid or a region is not rigid.
    fn add_joint(&mut self, joint: Joint) -> Result<()>;
}
