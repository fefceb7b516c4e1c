//! Updates of lagged friction within a step.

use super::contact_terms::{self_contact_mut, tool_contact_mut};
use super::linear_step::StepContext;
use super::newton::NewtonSolver;
use super::schemes::StepCoefficients;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;

/// Largest number of friction updates per step (lagged friction). One less than on the GPU, which
/// does not test whether the forces still change (`contact_convergence.wgsl`).
const MAX_FRICTION_UPDATES: u32 = 5;

/// Relative change of the normal forces above which another friction update follows.
const FRICTION_FORCE_TOLERANCE: f64 = 3e-3;

/// Residual below which steps, those of gradients, are solved until friction has converged: it
/// changes by less than ten times the residual.
const EXACT_RESIDUAL: f64 = 1e-6;

/// Largest number of friction updates of such a step, and of its iterations.
const MAX_EXACT_FRICTION_UPDATES: u32 = 100;
pub(super) const MAX_EXACT_ITERATIONS: u32 = 400;

impl<T: Real> NewtonSolver<T> {
    /// Updates the lagged normal forces of friction from the best trial, and re-evaluates it.
    /// Returns whether they changed significantly.
    pub(in crate::physics::cpu) fn update_lagged_friction(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> bool {
        let self_change = self_contact_mut(terms).map_or(0.0, |term| {
            term.update_lagged_friction(&self.best.displacements)
        });
        let change = tool_contact_mut(terms)
            .map_or(0.0, |c| c.update_lagged_friction(&self.best.displacements));
        let change = change.max(self_change);
        if change > 0.0 {
            self.evaluate_best(context, terms, coefficients);
        }
        change > self.friction_limits().0
    }

    /// Re-evaluates the best trial with the friction that there is now.
    pub(super) fn evaluate_best(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &[Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) {
        let (best, scratch) = (&mut self.best, &mut self.forces);
        best.evaluate(
            context,
            terms,
            &self.damping_displacements,
            scratch,
            coefficients,
        );
    }

    /// Whether steps are solved so far that lagged friction has converged.
    pub(in crate::physics::cpu) fn is_exact(&self) -> bool {
        self.settings.tolerance > 0.0 && self.settings.tolerance < EXACT_RESIDUAL
    }

    /// Whether tools or self-contact have friction.
    pub(in crate::physics::cpu) fn has_friction(&self, terms: &[Box<dyn Term<T>>]) -> bool {
        terms.iter().any(|term| term.is_friction() && term.damped())
    }

    /// Returns the relative change of the normal forces above which another friction update
    /// follows, and the largest number of updates.
    pub(in crate::physics::cpu) fn friction_limits(&self) -> (f64, u32) {
        match self.is_exact() {
            true => (10.0 * self.settings.tolerance, MAX_EXACT_FRICTION_UPDATES),
            false => (FRICTION_FORCE_TOLERANCE, MAX_FRICTION_UPDATES),
        }
    }
}
