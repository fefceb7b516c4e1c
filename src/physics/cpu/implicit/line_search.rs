//! How far to go along a direction: back from a whole step until the potential is lower.

use super::contact_iterations::{self_contact, tool_contact};
use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::NewtonSolver;
use super::schemes::StepCoefficients;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{V4, add_scaled};

/// A step of the line search is taken that lowers Φ by this part of what its slope promises.
const ARMIJO_C1: f64 = 1e-4;

/// The shortest step of the line search.
const MIN_STEP: f64 = 1e-7;

/// Where something touches, a length between what was reached and what was too far is tried so often,
/// as long as Φ falls by that part of what its slope promises: what is met on the way is met at once,
/// and a parabola tells little of where.
const MAX_REFINEMENTS: u32 = 3;
const CURVATURE_RATIO: f64 = 0.7;

impl<T: Real> NewtonSolver<T> {
    /// Goes along the solution until Φ is lower. Returns how much of it was gone, and how much
    /// lower; `None` where it is not to be had.
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
            // The minimum of the parabola through both ends, with the slope at the first.
            let bend = 2.0 * (length * gain - fall);
            let least = gain * length * length / bend;
            length = match least.is_finite() {
                true => least.clamp(0.1 * length, 0.5 * length),
                false => 0.1 * length,
            };
        }
        None
    }

    /// Goes on along the direction from the part `near` of it to less than `far`, which is too far,
    /// where Φ falls all the way; it was `before` at the start, with the slope `-gain`. As
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
            // Of lengths that differ by their size.
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
