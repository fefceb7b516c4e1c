//! How far to go along a direction: back from a whole step until the potential is lower.

use super::implicit::{Implicit, Scene};
use super::newton::Minimiser;
use super::newton_contact::{contact, touching};
use super::real::Real;
use super::rules::Form;
use super::terms::Term;
use super::vectors::{V4, add_scaled};

/// A step of the line search is taken that lowers Φ by this part of what its slope promises.
const ENOUGH: f64 = 1e-4;

/// The shortest step of the line search.
const SHORTEST: f64 = 1e-7;

/// Where something touches, a length between what was reached and what was too far is tried so often,
/// as long as Φ falls by that part of what its slope promises: what is met on the way is met at once,
/// and a parabola tells little of where.
const BETWEEN: u32 = 3;
const STEEP: f64 = 0.7;

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
        let mut length = self.free_way(scene, terms, direction);
        self.weigh_anew(scene, terms, form);
        let (before, slack) = (self.best.total(), self.best.slack());
        let how = self.how(form);
        let mut too_far = None;
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
                let tools = contact(terms).is_some_and(|c| !c.samples.is_empty());
                let touch = tools || touching(terms).is_some_and(|own| !own.is_empty());
                return Some(match too_far.filter(|_| touch) {
                    Some(far) => {
                        let slope = (before, gain);
                        self.go_on(scene, terms, form, direction, (length, far), slope)
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
    /// [`Minimiser::search`].
    fn go_on(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        direction: &[V4<T>],
        (mut near, mut far): (f64, f64),
        (before, gain): (f64, f64),
    ) -> (f64, f64) {
        let how = self.how(form);
        for _ in 0..BETWEEN {
            if before - self.best.total() < STEEP * near * gain {
                break;
            }
            // Of lengths that differ by their size.
            let length = (near * far).sqrt();
            let (more, step) = (length - near, T::of(length - near));
            self.rigid.go(more);
            let (from, trial, rigid) = (&self.best.delta, &mut self.trial, &self.rigid);
            let at = |i: usize| add_scaled(from[i], step, direction[i]);
            trial.put(scene, &self.guesses, how, rigid, at);
            if self.passes(scene, terms) {
                far = length;
                continue;
            }
            let trial = &mut self.trial;
            trial.weigh(scene, terms, &self.lagged, &mut self.forces, form);
            if trial.total() < self.best.total() {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept();
                near = length;
            } else {
                far = length;
            }
        }
        (near, before - self.best.total())
    }
}
