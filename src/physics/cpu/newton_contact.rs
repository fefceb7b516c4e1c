//! Steps in which tools touch: guesses that come to no harm, tools that go their way in stages, and
//! iterations until forces on tools are right.

use super::contact::{Contact, narrow, wide};
use super::implicit::{Implicit, Scene};
use super::newton::{Minimiser, PROJECTED};
use super::real::Real;
use super::rigid::RigidBodies;
use super::rules::Form;
use super::self_contact::Touching;
use super::terms::Term;
use super::vectors::{V4, add, add_scaled, apply, sub, weight, zero};
use crate::physics;
use crate::physics::contact::KEPT;
use glam::DVec3;

/// Residual to reach, over the forces of contact and what else moves the body.
const TOLERANCE: f64 = 1e-3;

/// Residual of linear solves.
const LINEAR: f64 = 1e-2;

/// Iterations of a step at most.
const ITERATIONS: u32 = 80;

/// Iterations of a step at most in which something is in the way of nodes that are led, which go on
/// whenever the square of the residual is so many times the one at which a step ends.
pub(super) const LEADING: u32 = 400;
pub(super) const EASED: f64 = 1e3;

/// How often friction takes over normal forces in a step at most, and the change of these, over
/// themselves, from which on it does so again.
pub(super) const RUBS: u32 = 5;
const SAME: f64 = 3e-3;

/// The square of the residual at which it takes them over, over that at which a step ends.
pub(super) const ROUGH: f64 = 100.0;

/// Iterations that are gone although they lower the potential by less than it is rounded: that of
/// contact is a small part of it.
pub(super) const FAINT: u32 = 6;

/// The part of their distance that parts of the body keep on a way that was cut short by them.
const PASSES: f64 = 0.5 * KEPT;

/// Rounds in which rigid bodies make way.
const ROUNDS: usize = 12;

/// The tools among some terms.
pub(super) fn contact<T: Real>(terms: &[Box<dyn Term<T>>]) -> Option<&Contact<T>> {
    terms.iter().find_map(|t| t.contact())
}

/// As [`contact`], to change them.
pub(super) fn contact_mut<T: Real>(terms: &mut [Box<dyn Term<T>>]) -> Option<&mut Contact<T>> {
    terms.iter_mut().find_map(|t| t.contact_mut())
}

/// The body's contact with itself among some terms.
pub(super) fn touching<T: Real>(terms: &[Box<dyn Term<T>>]) -> Option<&Touching<T>> {
    terms.iter().find_map(|t| t.touching())
}

/// As [`touching`], to change it.
pub(super) fn touching_mut<T: Real>(terms: &mut [Box<dyn Term<T>>]) -> Option<&mut Touching<T>> {
    terms.iter_mut().find_map(|t| t.touching_mut())
}

impl<T: Real> Minimiser<T> {
    /// Begins a step of tools and of contact of the body with itself: in how many stages they go, 0 where none comes near.
    pub(super) fn begin_contact(
        &mut self,
        implicit: &mut Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
    ) -> u32 {
        self.goal = self.settings;
        let mut stages = 0;
        if let Some(own) = touching_mut(terms) {
            let moved = |i: usize| form.reach * wide(scene.at.v[i]);
            let with = (scene.at.u, scene.free, scene.plan);
            if own.begin(with, &self.rigid, &moved) {
                stages = 1;
                implicit.forget_couplings();
            }
        }
        stages = stages.max(self.begin_tools(scene, terms, form));
        if stages == 0 {
            return 0;
        }
        self.begin_near(implicit);
        stages
    }

    /// Begins a step in which something may touch, which takes more iterations: in one stage.
    pub(super) fn begin_near(&mut self, implicit: &mut Implicit<T>) -> u32 {
        // Made of other points in contact: and so that a run that is resumed takes the same steps.
        implicit.forget_coarse();
        let own = self.settings;
        self.goal = physics::Newton {
            iterations: own.iterations.max(ITERATIONS),
            tolerance: match own.tolerance > 0.0 {
                true => own.tolerance.min(TOLERANCE),
                false => TOLERANCE,
            },
            linear: own.linear.min(LINEAR),
        };
        1
    }

    fn begin_tools(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
    ) -> u32 {
        let Some(contact) = contact_mut(terms) else {
            return 0;
        };
        let fastest = scene
            .at
            .v
            .iter()
            .map(|v| weight(*v, *v))
            .fold(0.0, f64::max);
        let margin = 2.0 * form.reach * fastest.sqrt();
        contact.begin(scene.at.u, (scene.free, scene.plan), (form.reach, margin))
    }

    /// Cuts the guess in `trial` short where it would go through tools, then has these go the share
    /// `to` of their way, for which nodes make way.
    pub(super) fn fit(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        to: f64,
    ) {
        if let Some(contact) = contact_mut(terms) {
            contact.stage(0.0);
        }
        let still = vec![zero(); scene.at.u.len()];
        self.shorten(scene, terms, form, (0.0, &still, scene.at.u), true);
        self.make_way(scene, terms, form, [0.0, to]);
    }

    /// Cuts the trial short where a part of the body goes through another on the way from another
    /// trial, or too deep into a tool: the part of their way that nodes that are led have gone there,
    /// its δ, and where its nodes are.
    fn shorten(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        (led, before, places): (f64, &[V4<T>], &[V4<T>]),
        tools: bool,
    ) {
        let leads = leads(scene) || self.rigid.targets.iter().any(Option::is_some);
        for round in 0..ROUNDS {
            let kept = if round == 0 { KEPT } else { PASSES };
            let way = self.way(scene, terms, [places, &self.trial.place], (kept, tools));
            if way >= 1.0 {
                return;
            }
            let part = match round {
                0 => way,
                _ if round + 1 < ROUNDS => 0.5 * way,
                _ => 0.0,
            };
            let ends = before.iter().zip(&self.trial.delta);
            let shortened = ends.map(|(a, b)| add_scaled(*a, T::of(part), sub(*b, *a)));
            self.moved = shortened.collect();
            if leads {
                self.led = led + part * (self.led - led);
                self.rigid.led = self.led;
            }
            let moved = &self.moved;
            let at = |i: usize| moved[i];
            self.rigid.guess(at);
            let how = self.how(form);
            self.trial.put(scene, &self.guesses, how, &self.rigid, at);
            // Straight ways keep what they are found to; what turns goes round.
            if self.rigid.is_empty() {
                return;
            }
        }
    }

    /// Has nodes that are led go on, as far as nothing is in their way, where something was.
    pub(super) fn lead_on(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
    ) {
        let led = std::mem::replace(&mut self.led, 1.0);
        self.rigid.led = 1.0;
        let (delta, places) = (self.best.delta.clone(), self.best.place.clone());
        let at = |i: usize| delta[i];
        self.rigid.repeat();
        let how = self.how(form);
        self.trial.put(scene, &self.guesses, how, &self.rigid, at);
        self.shorten(scene, terms, form, (led, &delta, &places), true);
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.weigh(scene, terms, &self.lagged, scratch, form);
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept();
    }

    /// Sees to it that all that may touch at the best trial is among the pairs. Whether anything is.
    pub(super) fn cover(&self, scene: &Scene<'_, T>, terms: &mut [Box<dyn Term<T>>]) -> bool {
        let Some(own) = touching_mut(terms) else {
            return false;
        };
        let with = (scene.free, scene.plan);
        own.cover([scene.at.u, &self.best.place], with, &self.rigid);
        !own.is_empty()
    }

    /// Has the tools go from one share of their way to another, for which the nodes of the trial
    /// make way.
    fn make_way(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        [from, to]: [f64; 2],
    ) {
        let how = self.how(form);
        // What makes way must not go through another part of the body.
        let own = touching(terms).is_some();
        let before = own.then(|| (self.trial.delta.clone(), self.trial.place.clone()));
        let Some(contact) = contact_mut(terms) else {
            return;
        };
        let mut any = false;
        for round in 0..ROUNDS {
            let start = if round == 0 { from } else { to };
            let pushed = contact.push_out(&self.trial.place, scene.free, [start, to]);
            if pushed.is_empty() {
                break;
            }
            any = true;
            self.moved.clone_from(&self.trial.delta);
            let mut shifts = vec![DVec3::ZERO; self.rigid.bodies.len()];
            for (i, by) in pushed {
                match self.rigid.of(i) {
                    Some(b) if by.length() > shifts[b].length() => shifts[b] = by,
                    Some(_) => {}
                    None => self.moved[i] = add(self.moved[i], narrow(by)),
                }
            }
            self.rigid.shift(&shifts);
            let moved = &self.moved;
            let at = |i: usize| moved[i];
            self.trial.put(scene, &self.guesses, how, &self.rigid, at);
        }
        if let Some((before, places)) = before.filter(|_| any) {
            self.shorten(scene, terms, form, (self.led, &before, &places), false);
        }
    }

    /// The part of the way between two displacements on which no point goes too deep into a tool, if
    /// these count, and parts of the body keep the part `kept` of their distances.
    fn way(
        &self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        [from, to]: [&[V4<T>]; 2],
        (kept, tools): (f64, bool),
    ) -> f64 {
        let with = (scene.free, scene.plan);
        let tools = contact_mut(terms).filter(|_| tools);
        let tools = tools.map_or(1.0, |c| c.way(from, to, with));
        let own = touching_mut(terms);
        tools.min(own.map_or(1.0, |own| own.way([from, to], with, &self.rigid, kept)))
    }

    /// Goes one iteration, and has the tools go on to the share `to` of their way. Returns the
    /// iterations of conjugate gradients.
    pub(super) fn advance_stage(
        &mut self,
        implicit: &mut Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        [from, to]: [f64; 2],
    ) -> u32 {
        self.residual(implicit, scene, terms, form);
        let mut iterations = 0;
        if let Some((_, outcome)) = self.solve(implicit, scene, terms, form, (0.0, 0.0)) {
            iterations = outcome.iterations;
            let gain = outcome.gain / (form.gamma * form.gamma);
            if self.search(implicit, scene, terms, form, gain).is_none() {
                self.projected = PROJECTED;
            }
        }
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.repeat();
        self.make_way(scene, terms, form, [from, to]);
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.weigh(scene, terms, &self.lagged, scratch, form);
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept();
        iterations
    }

    /// Takes friction's normal forces from the best trial, and weighs that again. Whether they have
    /// changed by what counts.
    pub(super) fn rub(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
    ) -> bool {
        let own = touching_mut(terms).map_or(0.0, |own| own.rub(&self.best.place));
        let change = contact_mut(terms).map_or(0.0, |c| c.rub(&self.best.place));
        let change = change.max(own);
        if change > 0.0 {
            let (best, scratch) = (&mut self.best, &mut self.forces);
            best.weigh(scene, terms, &self.lagged, scratch, form);
        }
        change > SAME
    }

    /// Weighs the best trial again where points were chosen anew, which friction goes by.
    pub(super) fn weigh_anew(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
    ) {
        self.chose = contact_mut(terms).is_some_and(|c| std::mem::take(&mut c.chosen));
        if self.chose {
            let (best, scratch) = (&mut self.best, &mut self.forces);
            best.weigh(scene, terms, &self.lagged, scratch, form);
        }
    }

    /// What residuals are measured by where tools touch, squared.
    pub(super) fn contact_weight(
        &self,
        implicit: &Implicit<T>,
        terms: &[Box<dyn Term<T>>],
        form: Form,
    ) -> f64 {
        let (inverse, square) = (&implicit.solver.inverse, form.gamma * form.gamma);
        let over = |i: usize, f: DVec3| {
            let force = narrow(square * f);
            weight(force, apply(&inverse[i], force))
        };
        let place = &self.best.place;
        let own = touching(terms).map_or(0.0, |own| own.weight(place, over));
        own + contact(terms).map_or(0.0, |contact| contact.weight(place, over))
    }

    /// The part of the whole direction on which no point goes too deep into a tool, and no part of
    /// the body through another.
    pub(super) fn free_way(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        direction: &[V4<T>],
    ) -> f64 {
        if contact(terms).is_none() && touching(terms).is_none() {
            return 1.0;
        }
        self.moved.clone_from(&self.best.place);
        let ways = direction.iter().zip(scene.free);
        for (to, (by, free)) in self.moved.iter_mut().zip(ways) {
            *to = add_scaled(*to, *free, *by);
        }
        self.way(scene, terms, [&self.best.place, &self.moved], (KEPT, true))
    }

    /// Whether the trial passes anything on its straight way from the best one: rigid bodies turn,
    /// and so do not go along their direction.
    pub(super) fn passes(&self, scene: &Scene<'_, T>, terms: &mut [Box<dyn Term<T>>]) -> bool {
        if self.rigid.is_empty() {
            return false;
        }
        let with = (scene.free, scene.plan);
        let (from, to) = (&self.best.place, &self.trial.place);
        let own = touching_mut(terms);
        own.is_some_and(|own| own.way([from, to], with, &self.rigid, PASSES) < 1.0)
    }
}

/// Whether any node is led along.
fn leads<T: Real>(scene: &Scene<'_, T>) -> bool {
    let mut nodes = scene.free.iter().zip(scene.at.v);
    nodes.any(|(free, v)| *free == T::ZERO && wide(*v) != DVec3::ZERO)
}

/// How nodes of a body at `u` come out of its tools where these stand.
pub(super) fn clear<T: Real>(
    contact: &mut Contact<T>,
    u: &[V4<T>],
    free: &[T],
) -> Vec<(usize, DVec3)> {
    contact.push_out(u, free, [0.0, 0.0])
}

/// Pushes nodes, and rigid bodies by what their nodes are pushed the most.
pub(super) fn put<T: Real>(
    pushed: Vec<(usize, DVec3)>,
    u: &mut [V4<T>],
    rigid: Option<&mut RigidBodies>,
) {
    let bodies = rigid.as_ref().map_or(0, |r| r.bodies.len());
    let mut shifts = vec![DVec3::ZERO; bodies];
    for (i, by) in pushed {
        match rigid.as_ref().and_then(|r| r.of(i)) {
            Some(b) if by.length() > shifts[b].length() => shifts[b] = by,
            Some(_) => {}
            None => u[i] = add(u[i], narrow(by)),
        }
    }
    if let Some(rigid) = rigid.filter(|r| !r.is_empty()) {
        rigid.shift_now(&shifts);
        rigid.put(&rigid.now, u);
    }
}
