//! How far to go along a direction: back from a whole step until the potential is lower.

use super::implicit::{Implicit, Scene};
use super::newton::Minimiser;
use super::real::Real;
use super::rules::Form;
use super::terms::Term;
use super::vectors::add_scaled;

/// A step of the line search is taken that lowers Φ by this part of what its slope promises.
const ENOUGH: f64 = 1e-4;

/// The shortest step of the line search.
const SHORTEST: f64 = 1e-7;

impl<T: Real> Minimiser<T> {
    /// Goes along the solution until Φ is lower. Returns how much of it was gone, and how much
    /// lower; `None` where it is not to be had.
    pub(super) fn search(
        &mut self,
        implicit: &Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        gain: f64,
    ) -> Option<(f64, f64)> {
        let direction = &implicit.solver.solution;
        self.rigid.read_directions(direction);
        let (before, slack) = (self.best.total(), self.best.slack());
        let mut length = self.free_way(scene, terms, direction);
        let how = self.how(form);
        while length >= SHORTEST {
            let step = T::of(length);
            self.rigid.go(length);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.put(scene, &self.guesses, how, rigid, at);
            if self.passes(scene, terms) {
                length *= 0.5;
                continue;
            }
            let trial = &mut self.trial;
            trial.weigh(scene, terms, &self.lagged, &mut self.forces, form);
            let fall = before - trial.total();
            if fall >= ENOUGH * length * gain - slack {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept();
                return Some((length, fall));
            }
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
}
