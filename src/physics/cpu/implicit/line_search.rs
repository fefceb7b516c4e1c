//! Backtracking line search on the incremental potential.

use super::contact_terms::{self_contact, tool_contact};
use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::NewtonSolver;
use super::schemes::StepCoefficients;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{V4, add_scaled};

/// Armijo parameter: required decrease of Φ as a fraction of that predicted by its slope.
const ARMIJO_C1: f64 = 1e-4;

/// Smallest step length of the line search.
const MIN_STEP: f64 = 1e-7;

/// In contact, maximum number of trials between the accepted and the rejected step length: the
/// onset of contact is abrupt, and a parabola does not predict it.
const MAX_REFINEMENTS: u32 = 3;

/// These trials continue while Φ decreases by this fraction of the decrease predicted by its slope.
const REFINEMENT_DECREASE_RATIO: f64 = 0.7;

impl<T: Real> NewtonSolver<T> {
    /// Searches along the solution until Φ decreases. Returns the step length and the decrease;
    /// `None` if there is none.
    pub(in crate::physics::cpu) fn line_search(
        &mut self,
        linear_solver: &LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        predicted_decrease: f64,
    ) -> Option<(f64, f64)> {
        let direction = &linear_solver.solver.solution;
        self.rigid.read_directions(direction);
        let mut length = self.collision_free_step(context, terms, direction);
        self.reevaluate(context, terms, coefficients);
        let (before, slack) = (self.best.total(), self.best.rounding_error());
        let trial_coefficients = self.trial_coefficients(coefficients);
        let mut rejected_length = None;
        while length >= MIN_STEP {
            let step = T::from_f64(length);
            self.rigid.move_trial(length);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.set_displacement(context, &self.guesses, trial_coefficients, rigid, at);
            if self.trial_collides(context, terms) {
                length *= 0.5;
                continue;
            }
            let trial = &mut self.trial;
            trial.evaluate(
                context,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                coefficients,
            );
            let decrease = before - trial.total();
            if decrease >= ARMIJO_C1 * length * predicted_decrease - slack {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                let tools = tool_contact(terms).is_some_and(|c| !c.contact_points.is_empty());
                let has_contact = tools || self_contact(terms).is_some_and(|own| !own.is_empty());
                return Some(match rejected_length.filter(|_| has_contact) {
                    Some(rejected) => {
                        let slope = (before, predicted_decrease);
                        self.refine_bracket(
                            context,
                            terms,
                            coefficients,
                            direction,
                            (length, rejected),
                            slope,
                        )
                    }
                    None => (length, decrease),
                });
            }
            rejected_length = Some(length);
            // Minimum of the parabola through both ends, with the slope at the first.
            let curvature = 2.0 * (length * predicted_decrease - decrease);
            let minimiser = predicted_decrease * length * length / curvature;
            length = match minimiser.is_finite() {
                true => minimiser.clamp(0.1 * length, 0.5 * length),
                false => 0.1 * length,
            };
        }
        None
    }

    /// Extends the step from the fraction `accepted` of the direction towards `rejected`, which is
    /// too long, while Φ decreases; Φ was `before` at the start, with the slope
    /// `-predicted_decrease`. Returns as [`NewtonSolver::line_search`].
    fn refine_bracket(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        direction: &[V4<T>],
        (mut accepted, mut rejected): (f64, f64),
        (before, predicted_decrease): (f64, f64),
    ) -> (f64, f64) {
        let trial_coefficients = self.trial_coefficients(coefficients);
        for _ in 0..MAX_REFINEMENTS {
            if before - self.best.total()
                < REFINEMENT_DECREASE_RATIO * accepted * predicted_decrease
            {
                break;
            }
            // Geometric mean, since the lengths differ by orders of magnitude.
            let length = (accepted * rejected).sqrt();
            let (extension, step) = (length - accepted, T::from_f64(length - accepted));
            self.rigid.move_trial(extension);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.set_displacement(context, &self.guesses, trial_coefficients, rigid, at);
            if self.trial_collides(context, terms) {
                rejected = length;
                continue;
            }
            let trial = &mut self.trial;
            trial.evaluate(
                context,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                coefficients,
            );
            if trial.total() < self.best.total() {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                accepted = length;
            } else {
                rejected = length;
            }
        }
        (accepted, before - self.best.total())
    }
}
