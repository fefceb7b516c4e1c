//! Constraints and target springs of nodes.

use crate::{Error, Result};
use glam::DVec3;

/// A constraint or a target spring of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeConstraint {
    /// The node is fixed at a given position, at rest.
    Fixed {
        /// Node, in the file's numbering.
        node: u32,
        /// Position, m from the frame's origin.
        place: DVec3,
    },
    /// Prescribed displacement: the node starts at a position and moves with a given velocity.
    Prescribed {
        /// Node, in the file's numbering.
        node: u32,
        /// Current position, m from the frame's origin.
        place: DVec3,
        /// Velocity, m/s.
        velocity: DVec3,
    },
    /// A zero-length spring from the node to a target.
    Spring {
        /// Node, in the file's numbering.
        node: u32,
        /// Target position, m from the frame's origin.
        target: DVec3,
        /// Stiffness, N/m.
        stiffness: f64,
        /// Largest force of the spring, N.
        limit: f64,
    },
}

impl NodeConstraint {
    /// Returns the constrained node.
    pub fn node(&self) -> u32 {
        match self {
            NodeConstraint::Fixed { node, .. }
            | NodeConstraint::Prescribed { node, .. }
            | NodeConstraint::Spring { node, .. } => *node,
        }
    }

    fn is_finite(&self) -> bool {
        match self {
            NodeConstraint::Fixed { place, .. } => place.is_finite(),
            NodeConstraint::Prescribed {
                place, velocity, ..
            } => place.is_finite() && velocity.is_finite(),
            NodeConstraint::Spring {
                target,
                stiffness,
                limit,
                ..
            } => target.is_finite() && stiffness.is_finite() && *stiffness >= 0.0 && *limit >= 0.0,
        }
    }
}

/// Checks the attachments of a body of `nodes` nodes.
///
/// # Errors
/// [`Error::Input`].
pub fn check_attachments(attachments: &[NodeConstraint], nodes: usize) -> Result<()> {
    let strange = |a: &&NodeConstraint| a.node() as usize >= nodes || !a.is_finite();
    match attachments.iter().find(strange) {
        None => Ok(()),
        Some(a) => Err(Error::Input(format!(
            "invalid constraint {a:?} of a body of {nodes} nodes; give existing nodes, finite points, and a stiffness and limit ≥ 0"
        ))),
    }
}
