//! Builds the joints of a scene.

use super::{JointEntry, LabelOrName};
use crate::mesh::TetMesh;
use crate::physics::{Joint, JointKind};
use crate::{Error, Result};
use glam::DVec3;

impl JointEntry {
    /// Returns the joint between regions of `mesh`.
    ///
    /// # Errors
    /// [`Error::Input`] for unknown regions, a number of regions other than one or two, or a number
    /// of joint kinds other than one.
    pub(super) fn joint(&self, mesh: &TetMesh) -> Result<Joint> {
        let label = |of: &LabelOrName| of.label(mesh);
        let between = match self.between.as_slice() {
            [a] => (label(a)?, None),
            [a, b] => (label(a)?, Some(label(b)?)),
            other => {
                return Err(Error::Input(format!(
                    "`between` of a [[joint]] must list two rigid regions, or one to join it to the world, got {}",
                    other.len()
                )));
            }
        };
        let radians = |[low, high]: [f64; 2]| [low.to_radians(), high.to_radians()];
        let kind = match (&self.hinge, &self.slider, &self.ball, &self.fixed) {
            (Some(h), None, None, None) => {
                JointKind::Hinge(DVec3::from(h.axis), h.limits.map(radians))
            }
            (None, Some(s), None, None) => JointKind::Slider(DVec3::from(s.axis), s.limits),
            (None, None, Some(_), None) => JointKind::Ball,
            (None, None, None, Some(_)) => JointKind::Fixed,
            _ => {
                return Err(Error::Input(
                    "a [[joint]] must have exactly one of `hinge`, `slider`, `ball` and `fixed`"
                        .into(),
                ));
            }
        };
        Ok(Joint {
            regions: between,
            anchor: DVec3::from(self.at),
            kind,
        })
    }
}
