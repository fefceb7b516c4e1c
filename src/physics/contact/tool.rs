//! Tools: rigid shapes that press on a body, with their poses and contact parameters.

use super::Shape;
use crate::mesh::{TetMesh, Topology};
use crate::{Error, Result};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Identifies a tool of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolId(pub(in crate::physics) usize);

impl ToolId {
    /// Returns the tool of a body that was added after `index` others.
    pub fn from_index(index: usize) -> ToolId {
        ToolId(index)
    }
}

/// Pose of a tool: position of its shape's origin, in file units, and rotation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToolPose {
    /// The origin of its shape, in file units.
    pub position: [f64; 3],
    /// Rotation as a quaternion: x, y, z, w.
    pub rotation: [f64; 4],
}

impl ToolPose {
    /// A pose at `position`, rotated by `rotation`.
    pub fn new(position: DVec3, rotation: DQuat) -> ToolPose {
        ToolPose {
            position: position.to_array(),
            rotation: rotation.normalize().to_array(),
        }
    }

    /// The origin of its shape, in file units.
    pub fn position(&self) -> DVec3 {
        self.position.into()
    }

    /// The rotation.
    pub fn rotation(&self) -> DQuat {
        DQuat::from_array(self.rotation)
    }

    /// Transforms a point from the frame of the tool's shape to world coordinates.
    pub fn transform_point(&self, p: DVec3) -> DVec3 {
        self.position() + self.rotation() * p
    }

    fn is_finite(&self) -> bool {
        let rotation = self.rotation();
        self.position().is_finite() && rotation.is_finite() && rotation.length() > 0.0
    }
}

/// A rigid shape that presses on a body.
#[derive(Clone, Debug)]
pub struct Tool {
    /// Its shape, in file units.
    pub shape: Shape,
    /// The initial pose.
    pub pose: ToolPose,
    /// Coefficient μ of Coulomb friction.
    pub friction: f64,
    /// Activation gap of the barrier, in file units; `None` chooses it from the tool and the mesh.
    pub gap: Option<f64>,
}

/// Motion of a tool within a step in local units: position and rotation at the start and the end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::physics) struct ToolMotion {
    pub from: [[f64; 4]; 2],
    pub to: [[f64; 4]; 2],
}

/// Penetration of a body into a tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Penetration {
    /// Number of nodes inside the tool.
    pub nodes: usize,
    /// Largest penetration depth, in file units.
    pub depth: f64,
}

impl Tool {
    /// Validates the shape, friction, gap and pose.
    ///
    /// # Errors
    /// [`Error::Input`] for a value out of range.
    pub fn check(&self) -> Result<()> {
        let fits = |x: f64| x.is_finite() && x > 0.0;
        let wrong = match &self.shape {
            Shape::Sphere { radius } if !fits(*radius) => {
                Some(format!("a sphere of radius {radius}"))
            }
            Shape::Capsule { radius, length }
                if !(fits(*radius) && length.is_finite() && *length >= 0.0) =>
            {
                Some(format!("a capsule of radius {radius} and length {length}"))
            }
            Shape::Box { half } if !half.to_array().into_iter().all(fits) => {
                Some(format!("a box of edges {}", 2.0 * *half))
            }
            _ => None,
        };
        if let Some(what) = wrong {
            return Err(Error::Input(format!(
                "invalid tool shape: {what}; give finite lengths > 0 (capsule length ≥ 0)"
            )));
        }
        if !(self.friction.is_finite() && self.friction >= 0.0) {
            return Err(Error::Input(format!(
                "tool friction must be finite and ≥ 0, got {}",
                self.friction
            )));
        }
        if let Some(gap) = self.gap.filter(|gap| !fits(*gap)) {
            return Err(Error::Input(format!(
                "tool gap must be finite and > 0, got {gap}"
            )));
        }
        check_pose(&self.pose)
    }

    /// Returns the penetration of the boundary of `mesh` at rest into the tool in its initial pose.
    pub(crate) fn initial_penetration(&self, mesh: &TetMesh, topology: &Topology) -> Penetration {
        let boundary = topology.all_boundary_nodes(mesh);
        let nodes = boundary.into_iter().map(|v| mesh.nodes[v as usize]);
        self.penetration(&self.pose, nodes)
    }

    /// Returns the penetration of the points `nodes`, in file units, into the tool at `pose`.
    pub(crate) fn penetration(
        &self,
        pose: &ToolPose,
        nodes: impl IntoIterator<Item = DVec3>,
    ) -> Penetration {
        let back = pose.rotation().inverse();
        let mut found = Penetration::default();
        for p in nodes {
            let distance = self.shape.distance(back * (p - pose.position()));
            if distance < 0.0 {
                found.nodes += 1;
                found.depth = found.depth.max(-distance);
            }
        }
        found
    }
}

/// Checks that a pose is finite and its rotation is not zero.
pub(in crate::physics) fn check_pose(pose: &ToolPose) -> Result<()> {
    match pose.is_finite() {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "invalid tool pose: position {:?}, rotation {:?}; give finite numbers and a non-zero rotation",
            pose.position, pose.rotation
        ))),
    }
}
