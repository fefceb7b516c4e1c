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

/// In contact, up to this many step lengths between the accepted and the rejected one are tried, as
/// long as Φ decreases by the given fraction of the decrease predicted by its slope: the onset of
/// contact is abrupt, and a parabola does not predict it.
const MAX_REFINEMENTS: u32 = 3;
const CURVATURE_RATIO: f64 = 0.7;

impl<T: Real> NewtonSolver<T> {
    /// Searches along the solution until Φ decreases. Returns the step length and the decrease;
    /// `None` if there is none.
    pub(in crate::physics::cpu) fn line_search(
        &mut self,
        implicit: &LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        gain: f64,
    ) -> Option<(f64, f64)> {
        let direction = &implicit.solver.solution;
        self.rigid.read_directions(direction);
        let mut length = self.collision_free_step(scene, terms, direction);
        self.reevaluate(scene, terms, form);
        let (before, slack) = (self.best.total(), self.best.rounding_error());
        let how = self.trial_coefficients(form);
        let mut too_far = None;
        while length >= MIN_STEP {
            let step = T::from_f64(length);
            self.rigid.move_trial(length);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.set_displacement(scene, &self.guesses, how, rigid, at);
            if self.trial_collides(scene, terms) {
                length *= 0.5;
                continue;
            }
            let trial = &mut self.trial;
            trial.evaluate(
                scene,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                form,
            );
            let fall = before - trial.total();
            if fall >= ARMIJO_C1 * length * gain - slack {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                let tools = tool_contact(terms).is_some_and(|c| !c.contact_points.is_empty());
                let touch = tools || self_contact(terms).is_some_and(|own| !own.is_empty());
                return Some(match too_far.filter(|_| touch) {
                    Some(far) => {
                        let slope = (before, gain);
                        self.refine_bracket(scene, terms, form, direction, (length, far), slope)
                    }
                    None => (length, fall),
                });
            }
            too_far = Some(length);
            // Minimum of the parabola through both ends, with the slope at the first.
            let bend = 2.0 * (length * gain - fall);
            let least = gain * length * length / bend;
            length = match least.is_finite() {
                true => least.clamp(0.1 * length, 0.5 * length),
                false => 0.1 * length,
            };
        }
        None
    }

    /// Extends the step from the fraction `near` of the direction towards `far`, which is too long,
    /// while Φ decreases; Φ was `before` at the start, with the slope `-gain`. Returns as
    /// [`NewtonSolver::line_search`].
    fn refine_bracket(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        direction: &[V4<T>],
        (mut near, mut far): (f64, f64),
        (before, gain): (f64, f64),
    ) -> (f64, f64) {
        let how = self.trial_coefficients(form);
        for _ in 0..MAX_REFINEMENTS {
            if before - self.best.total() < CURVATURE_RATIO * near * gain {
                break;
            }
            // Geometric mean, since the lengths differ by orders of magnitude.
            let length = (near * far).sqrt();
            let (more, step) = (length - near, T::from_f64(length - near));
            self.rigid.move_trial(more);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.set_displacement(scene, &self.guesses, how, rigid, at);
            if self.trial_collides(scene, terms) {
                far = length;
                continue;
            }
            let trial = &mut self.trial;
            trial.evaluate(
                scene,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                form,
            );
            if trial.total() < self.best.total() {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                near = length;
            } else {
                far = length;
            }
        }
        (near, before - self.best.total())
    }
}
