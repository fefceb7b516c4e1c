//! Joints between rigid regions.

use crate::{Error, Result};
use glam::DVec3;

/// A joint between two rigid regions, or from a region to the world, in the rest configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// The labels of the regions; `None` is the world.
    pub regions: (i64, Option<i64>),
    /// Anchor at rest, in file units.
    pub anchor: DVec3,
    /// The kind of joint.
    pub kind: JointKind,
}

/// The degrees of freedom of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointKind {
    /// None.
    Fixed,
    /// All rotations.
    Ball,
    /// Rotation about an axis; optional limits of the angle of the second region relative to the
    /// first, in radians.
    Hinge(DVec3, Option<[f64; 2]>),
    /// Translation along an axis; optional limits of the displacement of the second region relative
    /// to the first, in file units.
    Slider(DVec3, Option<[f64; 2]>),
}

impl Joint {
    /// Validates the joint.
    ///
    /// # Errors
    /// [`Error::Input`] if it connects a region with itself, the anchor is not finite, the axis is
    /// zero, or the limits exclude the rest configuration.
    pub fn check(&self) -> Result<()> {
        let refused = |what: String| Err(Error::Input(format!("invalid joint: {what}")));
        if self.regions.1 == Some(self.regions.0) {
            return refused(format!(
                "region {} is joined to itself; name two regions, or one to join it to the world",
                self.regions.0
            ));
        }
        if !self.anchor.is_finite() {
            return refused(format!("position must be finite, got {}", self.anchor));
        }
        let (JointKind::Hinge(axis, limits) | JointKind::Slider(axis, limits)) = self.kind else {
            return Ok(());
        };
        if !(axis.is_finite() && axis.length() > 0.0) {
            return refused(format!("axis must be finite and non-zero, got {axis}"));
        }
        match limits {
            Some([low, high]) if !(low <= 0.0 && 0.0 <= high && low < high) => refused(format!(
                "limits must contain 0, got {low} to {high}; give a lower limit ≤ 0 and an upper limit ≥ 0"
            )),
            _ => Ok(()),
        }
    }
}
