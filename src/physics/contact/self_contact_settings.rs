//! What a body's contact with itself goes by.

use crate::{Error, Result};

/// Contact of a body's boundary with itself: of its parts with each other, and of its folds.
///
/// Vertices and faces, and edges and edges, that come nearer than a gap push each other apart by the
/// barrier of incremental potential contact (Li et al. 2020), and no iteration of a step lets any pass
/// another. What is nearer at rest has a smaller gap of its own; what coincides at rest, such as the
/// two sides of a cut, is left alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SelfContactSettings {
    /// μ of Coulomb friction.
    pub friction: f64,
    /// The gap from which on parts push each other, in file units; a 20th of the boundary's mean
    /// edge where nothing is said.
    pub gap: Option<f64>,
}

impl SelfContactSettings {
    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// [`Error::Input`].
    pub fn check(&self) -> Result<()> {
        if !(self.friction.is_finite() && self.friction >= 0.0) {
            return Err(Error::Input(format!(
                "contact with a friction of {} makes no sense; give 0 or more",
                self.friction
            )));
        }
        match self.gap {
            Some(gap) if !(gap.is_finite() && gap > 0.0) => Err(Error::Input(format!(
                "contact from a gap of {gap} on makes no sense; give a positive length"
            ))),
            _ => Ok(()),
        }
    }
}
