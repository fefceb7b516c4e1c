//! Steps in which tools touch: guesses that come to no harm, tools that go their way in stages, and
//! iterations until forces on tools are right.

use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::{NewtonSolver, PROJECTED_SOLVES};
use super::schemes::StepCoefficients;
use crate::physics::NewtonSettings;
use crate::physics::contact::MIN_DISTANCE_RATIO;
use crate::physics::cpu::contact::self_contact::SelfContactTerm;
use crate::physics::cpu::contact::tool_contact::ToolContact;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, add, add_scaled, apply, dot_f64, sub, zero};
use glam::DVec3;

/// Residual to reach, over the forces of contact and what else moves the body.
const CONTACT_TOLERANCE: f64 = 1e-3;

/// Residual of linear solves.
const CONTACT_LINEAR_TOLERANCE: f64 = 1e-2;

/// Iterations of a step at most.
const MAX_CONTACT_ITERATIONS: u32 = 80;

/// Iterations of a step at most in which something is in the way of nodes that are led, which go on
/// whenever the square of the residual is so many times the one at which a step ends.
pub(in crate::physics::cpu) const MAX_BLOCKED_MOTION_ITERATIONS: u32 = 400;
pub(in crate::physics::cpu) const RESUME_RESIDUAL_RATIO: f64 = 1e3;

/// How often friction takes over normal forces in a step at most, and the change of these, over
/// themselves, from which on it does so again.
pub(in crate::physics::cpu) const MAX_FRICTION_UPDATES: u32 = 5;
const FRICTION_FORCE_TOLERANCE: f64 = 3e-3;

/// The square of the residual at which it takes them over, over that at which a step ends.
pub(in crate::physics::cpu) const FRICTION_UPDATE_RESIDUAL_RATIO: f64 = 100.0;

/// Iterations that are gone although they lower the potential by less than it is rounded: that of
/// contact is a small part of it.
pub(in crate::physics::cpu) const MAX_ROUNDOFF_ITERATIONS: u32 = 6;

/// The part of their distance that parts of the body keep on a way that was cut short by them.
const TRUNCATED_DISTANCE_RATIO: f64 = 0.5 * MIN_DISTANCE_RATIO;

/// Rounds in which rigid bodies make way.
const MAX_RIGID_PUSH_OUT_ROUNDS: usize = 12;

/// The tools among some terms.
pub(in crate::physics::cpu) fn tool_contact<T: Real>(
    terms: &[Box<dyn Term<T>>],
) -> Option<&ToolContact<T>> {
    terms.iter().find_map(|t| t.as_tool_contact())
}

/// As [`contact`], to change them.
pub(in crate::physics::cpu) fn contact_mut<T: Real>(
    terms: &mut [Box<dyn Term<T>>],
) -> Option<&mut ToolContact<T>> {
    terms.iter_mut().find_map(|t| t.contact_mut())
}

/// The body's contact with itself among some terms.
pub(in crate::physics::cpu) fn self_contact<T: Real>(
    terms: &[Box<dyn Term<T>>],
) -> Option<&SelfContactTerm<T>> {
    terms.iter().find_map(|t| t.as_self_contact())
}

/// As [`self_contact`], to change it.
pub(in crate::physics::cpu) fn touching_mut<T: Real>(
    terms: &mut [Box<dyn Term<T>>],
) -> Option<&mut SelfContactTerm<T>> {
    terms.iter_mut().find_map(|t| t.touching_mut())
}

impl<T: Real> NewtonSolver<T> {
    /// Begins a step of tools and of contact of the body with itself: in how many stages they go, 0 where none comes near.
    pub(in crate::physics::cpu) fn begin_contact(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) -> u32 {
        self.step_settings = self.settings;
        let mut stages = 0;
        if let Some(own) = touching_mut(terms) {
            let moved = |i: usize| form.evaluation_time * to_dvec(scene.at.v[i]);
            let with = (scene.at.u, scene.free, scene.plan);
            if own.begin(with, &self.rigid, &moved) {
                stages = 1;
                implicit.drop_aggregate_pattern();
            }
        }
        stages = stages.max(self.begin_tools(scene, terms, form));
        if stages == 0 {
            return 0;
        }
        self.begin_contact_iterations(implicit);
        stages
    }

    /// Begins a step in which something may touch, which takes more iterations: in one stage.
    pub(in crate::physics::cpu) fn begin_contact_iterations(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
    ) -> u32 {
        // Made of other points in contact: and so that a run that is resumed takes the same steps.
        implicit.drop_coarse_space();
        let own = self.settings;
        self.step_settings = NewtonSettings {
            iterations: own.iterations.max(MAX_CONTACT_ITERATIONS),
            tolerance: match own.tolerance > 0.0 {
                true => own.tolerance.min(CONTACT_TOLERANCE),
                false => CONTACT_TOLERANCE,
            },
            linear_tolerance: own.linear_tolerance.min(CONTACT_LINEAR_TOLERANCE),
        };
        1
    }

    fn begin_tools(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) -> u32 {
        let Some(contact) = contact_mut(terms) else {
            return 0;
        };
        let fastest = scene
            .at
            .v
            .iter()
            .map(|v| dot_f64(*v, *v))
            .fold(0.0, f64::max);
        let margin = 2.0 * form.evaluation_time * fastest.sqrt();
        contact.begin(
            scene.at.u,
            (scene.free, scene.plan),
            (form.evaluation_time, margin),
        )
    }

    /// Cuts the guess in `trial` short where it would go through tools, then has these go the share
    /// `to` of their way, for which nodes make way.
    pub(in crate::physics::cpu) fn truncate_guess(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        to: f64,
    ) {
        if let Some(contact) = contact_mut(terms) {
            contact.set_tool_fraction(0.0);
        }
        let still = vec![zero(); scene.at.u.len()];
        self.truncate_at_collision(scene, terms, form, (0.0, &still, scene.at.u), true);
        self.push_out_for_tools(scene, terms, form, [0.0, to]);
    }

    /// Cuts the trial short where a part of the body goes through another on the way from another
    /// trial, or too deep into a tool: the part of their way that nodes that are led have gone there,
    /// its δ, and where its nodes are.
    fn truncate_at_collision(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        (led, before, places): (f64, &[V4<T>], &[V4<T>]),
        tools: bool,
    ) {
        let leads = has_prescribed_motion(scene) || self.rigid.targets.iter().any(Option::is_some);
        for round in 0..MAX_RIGID_PUSH_OUT_ROUNDS {
            let kept = if round == 0 {
                MIN_DISTANCE_RATIO
            } else {
                TRUNCATED_DISTANCE_RATIO
            };
            let way = self.collision_free_fraction(
                scene,
                terms,
                [places, &self.trial.displacements],
                (kept, tools),
            );
            if way >= 1.0 {
                return;
            }
            let part = match round {
                0 => way,
                _ if round + 1 < MAX_RIGID_PUSH_OUT_ROUNDS => 0.5 * way,
                _ => 0.0,
            };
            let ends = before.iter().zip(&self.trial.delta);
            let shortened = ends.map(|(a, b)| add_scaled(*a, T::from_f64(part), sub(*b, *a)));
            self.pushed_displacements = shortened.collect();
            if leads {
                self.prescribed_fraction = led + part * (self.prescribed_fraction - led);
                self.rigid.prescribed_fraction = self.prescribed_fraction;
            }
            let moved = &self.pushed_displacements;
            let at = |i: usize| moved[i];
            self.rigid.set_trial_from(at);
            let how = self.trial_coefficients(form);
            self.trial
                .set_displacement(scene, &self.guesses, how, &self.rigid, at);
            // Straight ways keep what they are found to; what turns goes round.
            if self.rigid.is_empty() {
                return;
            }
        }
    }

    /// Has nodes that are led go on, as far as nothing is in their way, where something was.
    pub(in crate::physics::cpu) fn advance_prescribed_motion(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) {
        let led = std::mem::replace(&mut self.prescribed_fraction, 1.0);
        self.rigid.prescribed_fraction = 1.0;
        let (delta, places) = (self.best.delta.clone(), self.best.displacements.clone());
        let at = |i: usize| delta[i];
        self.rigid.copy_best_to_trial();
        let how = self.trial_coefficients(form);
        self.trial
            .set_displacement(scene, &self.guesses, how, &self.rigid, at);
        self.truncate_at_collision(scene, terms, form, (led, &delta, &places), true);
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.evaluate(scene, terms, &self.damping_displacements, scratch, form);
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept_trial();
    }

    /// Sees to it that all that may touch at the best trial is among the pairs. Whether anything is.
    pub(in crate::physics::cpu) fn refresh_candidates(
        &self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
    ) -> bool {
        let Some(own) = touching_mut(terms) else {
            return false;
        };
        let with = (scene.free, scene.plan);
        own.refresh_candidates([scene.at.u, &self.best.displacements], with, &self.rigid);
        !own.is_empty()
    }

    /// Has the tools go from one share of their way to another, for which the nodes of the trial
    /// make way.
    fn push_out_for_tools(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        [from, to]: [f64; 2],
    ) {
        let how = self.trial_coefficients(form);
        // What makes way must not go through another part of the body.
        let own = self_contact(terms).is_some();
        let before = own.then(|| (self.trial.delta.clone(), self.trial.displacements.clone()));
        let Some(contact) = contact_mut(terms) else {
            return;
        };
        let mut any = false;
        for round in 0..MAX_RIGID_PUSH_OUT_ROUNDS {
            let start = if round == 0 { from } else { to };
            let pushed = contact.push_out(&self.trial.displacements, scene.free, [start, to]);
            if pushed.is_empty() {
                break;
            }
            any = true;
            self.pushed_displacements.clone_from(&self.trial.delta);
            let mut shifts = vec![DVec3::ZERO; self.rigid.bodies.len()];
            for (i, by) in pushed {
                match self.rigid.body_of(i) {
                    Some(b) if by.length() > shifts[b].length() => shifts[b] = by,
                    Some(_) => {}
                    None => {
                        self.pushed_displacements[i] = add(self.pushed_displacements[i], to_v4(by))
                    }
                }
            }
            self.rigid.shift(&shifts);
            let moved = &self.pushed_displacements;
            let at = |i: usize| moved[i];
            self.trial
                .set_displacement(scene, &self.guesses, how, &self.rigid, at);
        }
        if let Some((before, places)) = before.filter(|_| any) {
            self.truncate_at_collision(
                scene,
                terms,
                form,
                (self.prescribed_fraction, &before, &places),
                false,
            );
        }
    }

    /// The part of the way between two displacements on which no point goes too deep into a tool, if
    /// these count, and parts of the body keep the part `kept` of their distances.
    fn collision_free_fraction(
        &self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        [from, to]: [&[V4<T>]; 2],
        (kept, tools): (f64, bool),
    ) -> f64 {
        let with = (scene.free, scene.plan);
        let tools = contact_mut(terms).filter(|_| tools);
        let tools = tools.map_or(1.0, |c| c.collision_free_fraction(from, to, with));
        let own = touching_mut(terms);
        tools.min(own.map_or(1.0, |own| {
            own.collision_free_fraction([from, to], with, &self.rigid, kept)
        }))
    }

    /// Goes one iteration, and has the tools go on to the share `to` of their way. Returns the
    /// iterations of conjugate gradients.
    pub(in crate::physics::cpu) fn advance_tool_stage(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        [from, to]: [f64; 2],
    ) -> u32 {
        self.residual(implicit, scene, terms, form);
        let mut iterations = 0;
        if let Some((_, outcome)) = self.solve(implicit, scene, terms, form, (0.0, 0.0)) {
            iterations = outcome.iterations;
            let gain = outcome.predicted_decrease / (form.gamma * form.gamma);
            if self
                .line_search(implicit, scene, terms, form, gain)
                .is_none()
            {
                self.projected = PROJECTED_SOLVES;
            }
        }
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.copy_best_to_trial();
        self.push_out_for_tools(scene, terms, form, [from, to]);
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.evaluate(scene, terms, &self.damping_displacements, scratch, form);
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept_trial();
        iterations
    }

    /// Takes friction's normal forces from the best trial, and weighs that again. Whether they have
    /// changed by what counts.
    pub(in crate::physics::cpu) fn update_friction(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) -> bool {
        let own =
            touching_mut(terms).map_or(0.0, |own| own.update_friction(&self.best.displacements));
        let change =
            contact_mut(terms).map_or(0.0, |c| c.update_friction(&self.best.displacements));
        let change = change.max(own);
        if change > 0.0 {
            let (best, scratch) = (&mut self.best, &mut self.forces);
            best.evaluate(scene, terms, &self.damping_displacements, scratch, form);
        }
        change > FRICTION_FORCE_TOLERANCE
    }

    /// Weighs the best trial again where points were chosen anew, which friction goes by.
    pub(in crate::physics::cpu) fn reevaluate(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) {
        self.candidates_changed =
            contact_mut(terms).is_some_and(|c| std::mem::take(&mut c.candidates_changed));
        if self.candidates_changed {
            let (best, scratch) = (&mut self.best, &mut self.forces);
            best.evaluate(scene, terms, &self.damping_displacements, scratch, form);
        }
    }

    /// What residuals are measured by where tools touch, squared.
    pub(in crate::physics::cpu) fn contact_weight(
        &self,
        implicit: &LinearStepSolver<T>,
        terms: &[Box<dyn Term<T>>],
        form: StepCoefficients,
    ) -> f64 {
        let (inverse, square) = (&implicit.solver.inverse, form.gamma * form.gamma);
        let over = |i: usize, f: DVec3| {
            let force = to_v4(square * f);
            dot_f64(force, apply(&inverse[i], force))
        };
        let place = &self.best.displacements;
        let own = self_contact(terms).map_or(0.0, |own| own.weight(place, over));
        own + tool_contact(terms).map_or(0.0, |contact| contact.residual_scale(place, over))
    }

    /// The part of the whole direction on which no point goes too deep into a tool, and no part of
    /// the body through another.
    pub(in crate::physics::cpu) fn collision_free_step(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        direction: &[V4<T>],
    ) -> f64 {
        if tool_contact(terms).is_none() && self_contact(terms).is_none() {
            return 1.0;
        }
        self.pushed_displacements
            .clone_from(&self.best.displacements);
        let ways = direction.iter().zip(scene.free);
        for (to, (by, free)) in self.pushed_displacements.iter_mut().zip(ways) {
            *to = add_scaled(*to, *free, *by);
        }
        self.collision_free_fraction(
            scene,
            terms,
            [&self.best.displacements, &self.pushed_displacements],
            (MIN_DISTANCE_RATIO, true),
        )
    }

    /// Whether the trial passes anything on its straight way from the best one: rigid bodies turn,
    /// and so do not go along their direction.
    pub(in crate::physics::cpu) fn trial_collides(
        &self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
    ) -> bool {
        if self.rigid.is_empty() {
            return false;
        }
        let with = (scene.free, scene.plan);
        let (from, to) = (&self.best.displacements, &self.trial.displacements);
        let own = touching_mut(terms);
        own.is_some_and(|own| {
            own.collision_free_fraction([from, to], with, &self.rigid, TRUNCATED_DISTANCE_RATIO)
                < 1.0
        })
    }
}

/// Whether any node is led along.
fn has_prescribed_motion<T: Real>(scene: &StepContext<'_, T>) -> bool {
    let mut nodes = scene.free.iter().zip(scene.at.v);
    nodes.any(|(free, v)| *free == T::ZERO && to_dvec(*v) != DVec3::ZERO)
}

/// How nodes of a body at `u` come out of its tools where these stand.
pub(in crate::physics::cpu) fn resolve_penetration<T: Real>(
    contact: &mut ToolContact<T>,
    u: &[V4<T>],
    free: &[T],
) -> Vec<(usize, DVec3)> {
    contact.push_out(u, free, [0.0, 0.0])
}

/// Pushes nodes, and rigid bodies by what their nodes are pushed the most.
pub(in crate::physics::cpu) fn apply_push_out<T: Real>(
    pushed: Vec<(usize, DVec3)>,
    u: &mut [V4<T>],
    rigid: Option<&mut RigidBodies>,
) {
    let bodies = rigid.as_ref().map_or(0, |r| r.bodies.len());
    let mut shifts = vec![DVec3::ZERO; bodies];
    for (i, by) in pushed {
        match rigid.as_ref().and_then(|r| r.body_of(i)) {
            Some(b) if by.length() > shifts[b].length() => shifts[b] = by,
            Some(_) => {}
            None => u[i] = add(u[i], to_v4(by)),
        }
    }
    if let Some(rigid) = rigid.filter(|r| !r.is_empty()) {
        rigid.shift_now(&shifts);
        rigid.write_nodes(&rigid.now, u);
    }
}
