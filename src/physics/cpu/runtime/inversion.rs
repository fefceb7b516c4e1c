//! Rejection of steps that invert tetrahedra.

use super::energy_guard::StepFailure;

/// Whether steps may invert tets, and whether the current state has inverted ones.
#[derive(Clone, Copy, Debug, Default)]
pub struct InversionCheck {
    /// Whether steps may invert tets.
    pub allowed: bool,
    /// Whether the current state has inverted tets, if known.
    present: Option<bool>,
}

impl InversionCheck {
    /// Forgets the current state, which was set from outside.
    pub fn invalidate(&mut self) {
        self.present = None;
    }

    /// Checks a step. `after` and `before` tell whether its end and its start have inverted tets;
    /// a body that starts with some may recover in several steps.
    ///
    /// # Errors
    /// [`StepFailure::InvertedTets`].
    pub fn check(&mut self, after: bool, before: impl FnOnce() -> bool) -> Result<(), StepFailure> {
        if after && !self.allowed && !*self.present.get_or_insert_with(before) {
            return Err(StepFailure::InvertedTets);
        }
        self.present = Some(after);
        Ok(())
    }
}
