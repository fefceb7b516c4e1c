//! Settings of self-contact.

use crate::{Error, Result};

/// Self-contact: contact between different parts of a body's boundary, and within its folds.
///
/// Vertex–face and edge–edge pairs closer than a gap repel each other by the barrier of incremental
/// potential contact (Li et al. 2020), and continuous collision detection (CCD) keeps every
/// iteration of a step free of intersections. Pairs closer than the gap at rest use a smaller gap;
/// pairs that coincide at rest, such as the two sides of a cut, are ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SelfContactSettings {
    /// Coefficient μ of Coulomb friction.
    pub friction: f64,
    /// Activation gap of the barrier, in file units. Default: 1/20 of the boundary's mean edge
    /// length.
    pub gap: Option<f64>,
}

impl SelfContactSettings {
    /// Validates the settings.
    ///
    /// # Errors
    /// [`Error::Input`] for a value out of range.
    pub fn check(&self) -> Result<()> {
        if !(self.friction.is_finite() && self.friction >= 0.0) {
            return Err(Error::Input(format!(
                "contact friction must be finite and ≥ 0, got {}",
                self.friction
            )));
        }
        match self.gap {
            Some(gap) if !(gap.is_finite() && gap > 0.0) => Err(Error::Input(format!(
                "contact gap must be finite and > 0, got {gap}"
            ))),
            _ => Ok(()),
        }
    }
}
