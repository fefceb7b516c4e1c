//! Joints between rigid regions.

use crate::{Error, Result};
use glam::DVec3;

/// A joint between two rigid regions, or of one to the world, where the body rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// The labels of the regions; the second is none for the world.
    pub regions: (i64, Option<i64>),
    /// Where it is at rest, in file units.
    pub anchor: DVec3,
    /// What it leaves free.
    pub kind: JointKind,
}

/// What a joint leaves free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointKind {
    /// Nothing.
    Fixed,
    /// All turns.
    Ball,
    /// Turns about an axis, of the second about the first between two angles in radians.
    Hinge(DVec3, Option<[f64; 2]>),
    /// Ways along an axis, of the second from the first between two lengths in file units.
    Slider(DVec3, Option<[f64; 2]>),
}

impl Joint {
    /// Refuses one that makes no sense.
    ///
    /// # Errors
    /// [`Error::Input`] for one of a region with itself, a place that is none, an axis without
    /// direction, or limits that leave out rest.
    pub fn check(&self) -> Result<()> {
        let refused = |what: String| Err(Error::Input(format!("a joint {what}")));
        if self.regions.1 == Some(self.regions.0) {
            return refused(format!(
                "joins region {} with itself; name two regions, or one, which is joined to the world",
                self.regions.0
            ));
        }
        if !self.anchor.is_finite() {
            return refused(format!("at {} is nowhere; give a point", self.anchor));
        }
        let (JointKind::Hinge(axis, limits) | JointKind::Slider(axis, limits)) = self.kind else {
            return Ok(());
        };
        if !(axis.is_finite() && axis.length() > 0.0) {
            return refused(format!("has the axis {axis}, which points nowhere"));
        }
        match limits {
            Some([low, high]) if !(low <= 0.0 && 0.0 <= high && low < high) => refused(format!(
                "that goes from {low} to {high} cannot rest at 0; give a lower limit of 0 or less and an upper one of 0 or more"
            )),
            _ => Ok(()),
        }
    }
}
