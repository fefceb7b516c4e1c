//! Contact handling in Newton's method: collision-free initial guesses, tool motion in stages,
//! friction updates, and iteration until contact forces converge.

use super::contact_terms::{self_contact, self_contact_mut, tool_contact, tool_contact_mut};
use super::friction_updates::MAX_EXACT_ITERATIONS;
use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::{NewtonSolver, PROJECTED_SOLVES};
use super::schemes::StepCoefficients;
use crate::physics::NewtonSettings;
use crate::physics::contact::MIN_DISTANCE_RATIO;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, add, add_scaled, apply, dot_f64, sub, zero};
use glam::DVec3;

/// Residual tolerance relative to the contact forces and other driving forces.
const CONTACT_TOLERANCE: f64 = 1e-3;

/// Largest number of iterations of a step with contact.
const MAX_CONTACT_ITERATIONS: u32 = 80;

/// Largest number of iterations of a step with blocked prescribed motion.
pub(in crate::physics::cpu) const MAX_BLOCKED_MOTION_ITERATIONS: u32 = 400;

/// Ratio of the squared residual to the squared convergence tolerance below which blocked
/// prescribed motion resumes.
pub(in crate::physics::cpu) const RESUME_RESIDUAL_RATIO: f64 = 1e3;

/// Ratio of the squared residual that triggers a friction update to the squared convergence
/// tolerance.
pub(in crate::physics::cpu) const FRICTION_UPDATE_RESIDUAL_RATIO: f64 = 100.0;

/// Largest number of iterations whose decrease of the potential is below its rounding error: the
/// contact potential is a small part of the total.
pub(in crate::physics::cpu) const MAX_ROUNDOFF_ITERATIONS: u32 = 6;

/// Fraction of their distance that parts of the body keep when a collision truncates a step.
const TRUNCATED_DISTANCE_RATIO: f64 = 0.5 * MIN_DISTANCE_RATIO;

/// Largest number of rounds in which rigid bodies are pushed out of tools.
const MAX_RIGID_PUSH_OUT_ROUNDS: usize = 12;

impl<T: Real> NewtonSolver<T> {
    /// Begins a step with tools and self-contact; returns the number of stages of tool motion, 0 if
    /// no contact is near.
    pub(in crate::physics::cpu) fn begin_contact(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> u32 {
        self.step_settings = self.settings;
        let mut stages = 0;
        if let Some(term) = self_contact_mut(terms) {
            term.is_exact = self.is_exact();
            let moved = |i: usize| coefficients.evaluation_time * to_dvec(context.at.v[i]);
            let node_context = (context.at.u, context.free, context.plan);
            if term.begin(node_context, &self.rigid, &moved) {
                stages = 1;
                linear_solver.drop_aggregate_pattern();
            }
        }
        stages = stages.max(self.begin_tools(context, terms, coefficients));
        if stages == 0 {
            return 0;
        }
        self.begin_contact_iterations(linear_solver);
        stages
    }

    /// Begins a step with possible contact, which takes more iterations, in one stage.
    pub(in crate::physics::cpu) fn begin_contact_iterations(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
    ) -> u32 {
        // The coarse space was built with other contact points; dropping it also makes a resumed
        // run take the same steps.
        linear_solver.drop_coarse_space();
        let settings = self.settings;
        self.step_settings = NewtonSettings {
            iterations: settings.iterations.max(match self.is_exact() {
                true => MAX_EXACT_ITERATIONS,
                false => MAX_CONTACT_ITERATIONS,
            }),
            tolerance: match settings.tolerance > 0.0 {
                true => settings.tolerance.min(CONTACT_TOLERANCE),
                false => CONTACT_TOLERANCE,
            },
            linear_tolerance: settings
                .linear_tolerance
                .min(linear_solver.contact_tolerance()),
        };
        1
    }

    fn begin_tools(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> u32 {
        let Some(contact) = tool_contact_mut(terms) else {
            return 0;
        };
        let max_speed_squared = context
            .at
            .v
            .iter()
            .map(|v| dot_f64(*v, *v))
            .fold(0.0, f64::max);
        let margin = 2.0 * coefficients.evaluation_time * max_speed_squared.sqrt();
        contact.begin(
            context.at.u,
            (context.free, context.plan),
            // Tools end the step where it ends, also if its forces are those at its middle.
            (
                coefficients.end_scale * coefficients.evaluation_time,
                margin,
            ),
        )
    }

    /// Truncates the guess in `trial` before it passes through tools, then moves the tools to the
    /// fraction `to` of their paths and pushes nodes out of them.
    pub(in crate::physics::cpu) fn truncate_guess(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        to: f64,
    ) {
        if let Some(contact) = tool_contact_mut(terms) {
            contact.set_tool_fraction(0.0);
        }
        let zero_displacements = vec![zero(); context.at.u.len()];
        self.truncate_at_collision(
            context,
            terms,
            coefficients,
            (0.0, &zero_displacements, context.at.u),
            true,
        );
        self.push_out_for_tools(context, terms, coefficients, [0.0, to]);
    }

    /// Truncates the trial where a part of the body would pass through another on the way from
    /// another trial, or penetrate a tool too deeply. The other trial is given by its fraction of
    /// the prescribed motion, its δ, and its displacements.
    fn truncate_at_collision(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        (start_fraction, before, displacements): (f64, &[V4<T>], &[V4<T>]),
        tools: bool,
    ) {
        let has_prescribed =
            has_prescribed_motion(context) || self.rigid.targets.iter().any(Option::is_some);
        for round in 0..MAX_RIGID_PUSH_OUT_ROUNDS {
            let min_distance_ratio = if round == 0 {
                MIN_DISTANCE_RATIO
            } else {
                TRUNCATED_DISTANCE_RATIO
            };
            let collision_free_fraction = self.collision_free_fraction(
                context,
                terms,
                [displacements, &self.trial.displacements],
                (min_distance_ratio, tools),
            );
            if collision_free_fraction >= 1.0 {
                return;
            }
            let fraction = match round {
                0 => collision_free_fraction,
                _ if round + 1 < MAX_RIGID_PUSH_OUT_ROUNDS => 0.5 * collision_free_fraction,
                _ => 0.0,
            };
            let ends = before.iter().zip(&self.trial.delta);
            let shortened = ends.map(|(a, b)| add_scaled(*a, T::from_f64(fraction), sub(*b, *a)));
            self.pushed_displacements = shortened.collect();
            if has_prescribed {
                self.prescribed_fraction =
                    start_fraction + fraction * (self.prescribed_fraction - start_fraction);
                self.rigid.prescribed_fraction = self.prescribed_fraction;
            }
            let moved = &self.pushed_displacements;
            let at = |i: usize| moved[i];
            self.rigid.set_trial_from(at);
            let trial_coefficients = self.trial_coefficients(coefficients);
            self.trial.set_displacement(
                context,
                &self.guesses,
                trial_coefficients,
                &self.rigid,
                at,
            );
            // The truncation holds for straight paths; rotating bodies follow arcs.
            if self.rigid.is_empty() {
                return;
            }
        }
    }

    /// Resumes truncated prescribed motion up to the next collision.
    pub(in crate::physics::cpu) fn advance_prescribed_motion(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) {
        let start_fraction = std::mem::replace(&mut self.prescribed_fraction, 1.0);
        self.rigid.prescribed_fraction = 1.0;
        let (delta, displacements) = (self.best.delta.clone(), self.best.displacements.clone());
        let at = |i: usize| delta[i];
        self.rigid.copy_best_to_trial();
        let trial_coefficients = self.trial_coefficients(coefficients);
        self.trial
            .set_displacement(context, &self.guesses, trial_coefficients, &self.rigid, at);
        self.truncate_at_collision(
            context,
            terms,
            coefficients,
            (start_fraction, &delta, &displacements),
            true,
        );
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.evaluate(
            context,
            terms,
            &self.damping_displacements,
            scratch,
            coefficients,
        );
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept_trial();
    }

    /// Updates the candidate pairs for the best trial. Returns whether there are any.
    pub(in crate::physics::cpu) fn refresh_candidates(
        &self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
    ) -> bool {
        let Some(term) = self_contact_mut(terms) else {
            return false;
        };
        let node_context = (context.free, context.plan);
        term.refresh_candidates(
            [context.at.u, &self.best.displacements],
            node_context,
            &self.rigid,
        );
        !term.is_empty()
    }

    /// Moves the tools from one fraction of their paths to another, and pushes nodes of the trial
    /// out of them.
    fn push_out_for_tools(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        [from, to]: [f64; 2],
    ) {
        let trial_coefficients = self.trial_coefficients(coefficients);
        // Pushed-out nodes must not pass through another part of the body.
        let has_self_contact = self_contact(terms).is_some();
        let before =
            has_self_contact.then(|| (self.trial.delta.clone(), self.trial.displacements.clone()));
        let Some(contact) = tool_contact_mut(terms) else {
            return;
        };
        let mut any = false;
        for round in 0..MAX_RIGID_PUSH_OUT_ROUNDS {
            let start = if round == 0 { from } else { to };
            let pushed = contact.push_out(&self.trial.displacements, context.free, [start, to]);
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
            self.trial.set_displacement(
                context,
                &self.guesses,
                trial_coefficients,
                &self.rigid,
                at,
            );
        }
        if let Some((before, displacements)) = before.filter(|_| any) {
            self.truncate_at_collision(
                context,
                terms,
                coefficients,
                (self.prescribed_fraction, &before, &displacements),
                false,
            );
        }
    }

    /// Returns the fraction of the path between two displacements on which no point penetrates a
    /// tool too deeply, if `tools` are included, and parts of the body keep the fraction
    /// `min_distance_ratio` of their distances.
    fn collision_free_fraction(
        &self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        [from, to]: [&[V4<T>]; 2],
        (min_distance_ratio, tools): (f64, bool),
    ) -> f64 {
        let node_context = (context.free, context.plan);
        let tools = tool_contact_mut(terms).filter(|_| tools);
        let tools = tools.map_or(1.0, |c| c.collision_free_fraction(from, to, node_context));
        let term = self_contact_mut(terms);
        tools.min(term.map_or(1.0, |term| {
            term.collision_free_fraction([from, to], node_context, &self.rigid, min_distance_ratio)
        }))
    }

    /// Takes one Newton iteration, then moves the tools to the fraction `to` of their paths.
    /// Returns the number of conjugate gradient iterations.
    pub(in crate::physics::cpu) fn advance_tool_stage(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        [from, to]: [f64; 2],
    ) -> u32 {
        self.residual(linear_solver, context, terms, coefficients);
        let mut iterations = 0;
        if let Some((_, outcome)) =
            self.solve(linear_solver, context, terms, coefficients, (0.0, 0.0))
        {
            iterations = outcome.iterations;
            let gain = outcome.predicted_decrease / (coefficients.gamma * coefficients.gamma);
            if self
                .line_search(linear_solver, context, terms, coefficients, gain)
                .is_none()
            {
                self.projected = PROJECTED_SOLVES;
            }
        }
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.copy_best_to_trial();
        self.push_out_for_tools(context, terms, coefficients, [from, to]);
        let (trial, scratch) = (&mut self.trial, &mut self.forces);
        trial.evaluate(
            context,
            terms,
            &self.damping_displacements,
            scratch,
            coefficients,
        );
        std::mem::swap(&mut self.best, &mut self.trial);
        self.rigid.accept_trial();
        iterations
    }

    /// Re-evaluates the best trial if the contact candidates changed, which friction depends on.
    pub(in crate::physics::cpu) fn reevaluate(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) {
        self.candidates_changed =
            tool_contact_mut(terms).is_some_and(|c| std::mem::take(&mut c.candidates_changed));
        if self.candidates_changed {
            self.evaluate_best(context, terms, coefficients);
        }
    }

    /// Returns the squared reference value of residuals in contact.
    pub(in crate::physics::cpu) fn contact_residual_scale(
        &self,
        linear_solver: &LinearStepSolver<T>,
        terms: &[Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> f64 {
        let (inverse, square) = (
            &linear_solver.solver.inverse,
            coefficients.gamma * coefficients.gamma,
        );
        let over = |i: usize, f: DVec3| {
            let force = to_v4(square * f);
            dot_f64(force, apply(&inverse[i], force))
        };
        let displacements = &self.best.displacements;
        let self_scale =
            self_contact(terms).map_or(0.0, |term| term.residual_scale(displacements, over));
        self_scale
            + tool_contact(terms).map_or(0.0, |contact| contact.residual_scale(displacements, over))
    }

    /// Returns the fraction of the direction on which no point penetrates a tool too deeply, and no
    /// part of the body passes through another.
    pub(in crate::physics::cpu) fn collision_free_step(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        direction: &[V4<T>],
    ) -> f64 {
        if tool_contact(terms).is_none() && self_contact(terms).is_none() {
            return 1.0;
        }
        self.pushed_displacements
            .clone_from(&self.best.displacements);
        let moves = direction.iter().zip(context.free);
        for (to, (by, free)) in self.pushed_displacements.iter_mut().zip(moves) {
            *to = add_scaled(*to, *free, *by);
        }
        self.collision_free_fraction(
            context,
            terms,
            [&self.best.displacements, &self.pushed_displacements],
            (MIN_DISTANCE_RATIO, true),
        )
    }

    /// Whether the trial collides on its straight path from the best one: rigid bodies rotate, and
    /// so leave their direction.
    pub(in crate::physics::cpu) fn trial_collides(
        &self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
    ) -> bool {
        if self.rigid.is_empty() {
            return false;
        }
        let node_context = (context.free, context.plan);
        let (from, to) = (&self.best.displacements, &self.trial.displacements);
        let term = self_contact_mut(terms);
        term.is_some_and(|term| {
            term.collision_free_fraction(
                [from, to],
                node_context,
                &self.rigid,
                TRUNCATED_DISTANCE_RATIO,
            ) < 1.0
        })
    }
}

/// Whether any node has a prescribed motion.
fn has_prescribed_motion<T: Real>(context: &StepContext<'_, T>) -> bool {
    let mut nodes = context.free.iter().zip(context.at.v);
    nodes.any(|(free, v)| *free == T::ZERO && to_dvec(*v) != DVec3::ZERO)
}
