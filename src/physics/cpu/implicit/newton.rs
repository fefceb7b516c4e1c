//! Newton's method for implicit steps in variational form.
//!
//! The incremental potential of a step (Gast et al. 2015, "Optimization Integrator for Large Time
//! Steps", section 4) is, with δ from the start of the step and the rest as in [`super::schemes`],
//!
//! Φ(δ) = ½ |δ − δ̂|²_M / γ² + E(x + δ) + γ (½ w·D w + ½ α |w|²_M), δ̂ = b + γ ṽ + γ² M⁻¹ f,
//!
//! with lagged D. Newton's method starts at the best of a few guesses, which largely determines the
//! progress of one iteration; rest at x is among them, because any tangled state recovers from it.
//! The Hessian is exact while that succeeds, and projected for a few solves when it fails.

use super::contact_iterations::{
    FRICTION_UPDATE_RESIDUAL_RATIO, MAX_BLOCKED_MOTION_ITERATIONS, MAX_FRICTION_UPDATES,
    MAX_ROUNDOFF_ITERATIONS, RESUME_RESIDUAL_RATIO,
};
use super::contact_terms::self_contact;
use super::initial_guess::{InitialGuess, InitialGuesses};
use super::linear_step::{LinearStepSolver, StepContext, negligible_movement};
use super::schemes::{ImplicitScheme, StepCoefficients};
use super::trial_state::{TrialState, has_inverted_tets};
use crate::physics::NewtonSettings;
use crate::physics::cpu::linear::cg::{CgTolerance, SystemOperator};
use crate::physics::cpu::node_constraints::Loads;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};
use crate::physics::cpu::vectors::{V4, add_scaled, scale, sub, zero};

/// Factor on the negligible movement of a single node: stiff bodies of many nodes can move as a
/// whole although no node alone would move noticeably.
const MIN_DIAGONAL_SHARE: f64 = 0.1;

/// Number of solves with projected blocks after exact ones failed.
pub(in crate::physics::cpu) const PROJECTED_SOLVES: u32 = 8;

/// If the ratio of the actual to the predicted decrease of Φ is at least this and at most its
/// inverse, the quadratic model of the iteration agrees.
const MODEL_AGREEMENT: f64 = 0.7;

/// After an iteration without agreement, another one is needed while the predicted decrease of Φ
/// exceeds this fraction of the largest one.
const CONVERGED_DECREASE_RATIO: f64 = 0.02;

/// Largest number of iterations of a step that starts with inverted tetrahedra: these recover
/// fastest in dissipative steps.
const MAX_ITERATIONS_INVERTED_START: u32 = 4;

/// Largest number of iterations of a step while it inverts any tetrahedron, which might stay
/// inverted.
const MAX_ITERATIONS_WHILE_INVERTING: u32 = 40;

/// Newton solver of a step, and its vectors.
#[derive(Clone, Debug)]
pub struct NewtonSolver<T> {
    /// Stopping criteria.
    pub settings: NewtonSettings,
    /// Implicit scheme.
    pub rule: ImplicitScheme,
    /// α, in local units.
    pub mass_damping: f64,
    /// Remaining solves with projected blocks.
    pub projected: u32,
    /// (1 + α γ) m.
    masses: Vec<T>,
    pub(in crate::physics::cpu) guesses: InitialGuesses<T>,
    pub(in crate::physics::cpu) best: TrialState<T>,
    pub(in crate::physics::cpu) trial: TrialState<T>,
    /// Displacements at which damping is evaluated.
    pub(in crate::physics::cpu) damping_displacements: Vec<V4<T>>,
    pub(in crate::physics::cpu) forces: Vec<V4<T>>,
    /// Rigid bodies.
    pub(in crate::physics::cpu) rigid: RigidBodies,
    /// Stopping criteria of the current step.
    pub(in crate::physics::cpu) step_settings: NewtonSettings,
    /// Displacements on the path to a trial; empty without contact.
    pub(in crate::physics::cpu) pushed_displacements: Vec<V4<T>>,
    /// Fraction of the prescribed motion of the step applied in trials: less than 1 if it is
    /// blocked.
    pub(in crate::physics::cpu) prescribed_fraction: f64,
    /// Whether the last line search changed the contact candidates.
    pub(in crate::physics::cpu) candidates_changed: bool,
}

/// Inputs of a step besides the state.
#[derive(Clone, Copy)]
pub struct StepInput<'a, T> {
    /// External loads.
    pub loads: &'a Loads<T>,
    /// Inverse masses; 0 for fixed nodes.
    pub inverse: &'a [T],
    /// Length of the previous step, local units; 0 for none.
    pub last: f64,
}

/// Result of a minimisation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NewtonResult {
    /// Conjugate gradient iterations.
    pub iterations: u32,
    /// Relative residual of the last linear solve.
    pub residual: f64,
    /// Energy of the terms at the evaluation time of the forces.
    pub elastic: f64,
}

impl<T: Real> NewtonSolver<T> {
    /// Creates a solver for a body partitioned by `plan`, with the scheme `rule`.
    pub fn new(
        plan: &Partition,
        (settings, rule): (NewtonSettings, ImplicitScheme),
        mass_damping: f64,
    ) -> NewtonSolver<T> {
        let nodes = plan.nodes();
        NewtonSolver {
            settings,
            rule,
            mass_damping,
            projected: 0,
            masses: vec![T::ZERO; nodes],
            guesses: InitialGuesses::new(nodes),
            best: TrialState::new(nodes),
            trial: TrialState::new(nodes),
            damping_displacements: Vec::new(),
            forces: vec![zero(); nodes],
            rigid: RigidBodies::default(),
            step_settings: settings,
            pushed_displacements: Vec::new(),
            prescribed_fraction: 1.0,
            candidates_changed: false,
        }
    }

    /// Returns the coefficients of a step of `h`, given the history in `implicit`.
    fn step_coefficients(
        &self,
        implicit: &LinearStepSolver<T>,
        h: f64,
        last: f64,
    ) -> StepCoefficients {
        let known = if implicit.solver.count == 2 {
            last
        } else {
            0.0
        };
        self.rule.coefficients(h, known)
    }

    /// Solves for δ. `None` if no guess has a finite energy.
    pub fn step(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        outside: StepInput<'_, T>,
        h: f64,
    ) -> Option<NewtonResult> {
        let form = self.step_coefficients(implicit, h, outside.last);
        self.scale_masses(scene, form.gamma);
        self.freeze_damping(scene, terms, form);
        let known = &implicit.solver.previous_solutions;
        let history = (implicit.solver.count == 2).then_some(known);
        self.rigid.midpoint = self.rule == ImplicitScheme::Midpoint;
        if outside.last == 0.0 {
            self.rigid.clear_torques();
        }
        let rigid = &self.rigid;
        self.guesses.prepare(scene, outside, history, form, rigid);
        let mut stages = self.begin_contact(implicit, scene, terms, form);
        let first = 1.0 / f64::from(stages.max(1));
        let touches = stages > 0 || self_contact(terms).is_some();
        if !self.start(scene, terms, form, touches.then_some(first)) {
            return None;
        }
        if self.refresh_candidates(scene, terms) && stages == 0 {
            implicit.drop_aggregate_pattern();
            stages = self.begin_contact_iterations(implicit);
        }
        let share = |stage: u32| f64::from(stage) / f64::from(stages.max(1));
        let mut descent = NewtonResult::default();
        for stage in 1..stages {
            let shares = [share(stage), share(stage + 1)];
            descent.iterations += self.advance_tool_stage(implicit, scene, terms, form, shares);
        }
        let mut first = 0.0;
        let most = match self.prescribed_fraction < 1.0 {
            true => self
                .step_settings
                .iterations
                .max(MAX_BLOCKED_MOTION_ITERATIONS),
            false => self.step_settings.iterations.max(1),
        };
        let mut best_gain = 0.0f64;
        let (mut friction_updates, mut roundoff_iterations) = (0, 0);
        // Whether prescribed motion resumes regardless of the residual.
        let mut resume_motion = false;
        // Whether no tetrahedron is inverted at the start, once known.
        let mut starts_uninverted = None;
        for round in 0..most.max(MAX_ITERATIONS_WHILE_INVERTING) {
            let mut went_on = false;
            let mut scale = self.residual(implicit, scene, terms, form);
            if stages > 0 {
                scale = scale.max(self.contact_weight(implicit, terms, form));
            }
            let before = if round > 0 {
                implicit.preconditioned_norm_squared(scene.plan)
            } else {
                f64::INFINITY
            };
            let mut goal = (self.step_settings.tolerance * self.step_settings.tolerance) * scale;
            if stages > 0 && friction_updates < MAX_FRICTION_UPDATES {
                goal *= FRICTION_UPDATE_RESIDUAL_RATIO;
            }
            if self.prescribed_fraction < 1.0
                && (std::mem::take(&mut resume_motion) || before <= RESUME_RESIDUAL_RATIO * goal)
            {
                self.advance_prescribed_motion(scene, terms, form);
                self.residual(implicit, scene, terms, form);
                went_on = true;
            }
            // The measure uses blocks of the previous step, which a resumed run does not have.
            if stages > 0 && round == 0 && self_contact(terms).is_some() {
                goal = 0.0;
            }
            if round > 0 && !went_on && before <= goal {
                if stages > 0 && friction_updates < MAX_FRICTION_UPDATES {
                    friction_updates += 1;
                    if self.update_friction(scene, terms, form) {
                        self.residual(implicit, scene, terms, form);
                    } else {
                        friction_updates = MAX_FRICTION_UPDATES;
                    }
                    continue;
                }
                break;
            }
            let Some((start, outcome)) = self.solve(implicit, scene, terms, form, (first, goal))
            else {
                resume_motion = self.prescribed_fraction < 1.0;
                if resume_motion {
                    continue;
                }
                break;
            };
            if round == 0 {
                first = start;
            }
            descent.iterations += outcome.iterations;
            descent.residual = outcome.residual;
            let gain = outcome.predicted_decrease / (form.gamma * form.gamma);
            let slack = self.best.rounding_error();
            let Some((length, fall)) = self.line_search(implicit, scene, terms, form, gain) else {
                // Exact blocks may give a bad direction; projected ones cannot, unless the contact
                // candidates changed.
                let astray = self.projected == 0 || self.candidates_changed;
                if (astray && gain > slack) || went_on {
                    self.projected = PROJECTED_SOLVES;
                    continue;
                }
                resume_motion = self.prescribed_fraction < 1.0;
                if resume_motion {
                    continue;
                }
                break;
            };
            if went_on || self.prescribed_fraction < 1.0 {
                continue;
            }
            let ratio = fall / (0.5 * gain);
            let trusted = length == 1.0 && ratio > MODEL_AGREEMENT && ratio < 1.0 / MODEL_AGREEMENT;
            roundoff_iterations += u32::from(gain <= slack);
            let spare = if stages > 0 {
                MAX_ROUNDOFF_ITERATIONS
            } else {
                0
            };
            if start <= goal || roundoff_iterations > spare {
                break;
            }
            best_gain = best_gain.max(gain);
            let by_energy = self.step_settings.tolerance == 0.0;
            let last = round + 1 >= most;
            let near = trusted && (round == 0 || gain <= CONVERGED_DECREASE_RATIO * best_gain);
            let enough = by_energy && (trusted || round + 1 >= MAX_ITERATIONS_INVERTED_START);
            if !(enough || last) {
                continue;
            }
            let wanted = (by_energy && !near && !last) || self.has_inverted_tets(scene, terms);
            let at = scene.at.u;
            if !(wanted
                && *starts_uninverted
                    .get_or_insert_with(|| !has_inverted_tets(scene.plan, terms, at)))
            {
                break;
            }
        }
        descent.elastic = self.best.elastic;
        Some(descent)
    }

    /// Whether tetrahedra are inverted at the evaluation time of the forces: at the end of the
    /// step, or for the midpoint rule at its middle.
    fn has_inverted_tets(&self, scene: &StepContext<'_, T>, terms: &[Box<dyn Term<T>>]) -> bool {
        has_inverted_tets(scene.plan, terms, &self.best.displacements)
    }

    /// Writes the state at the end of the step.
    pub fn finish(
        &mut self,
        scene: &StepContext<'_, T>,
        implicit: &LinearStepSolver<T>,
        (h, last): (f64, f64),
        next: (&mut [V4<T>], &mut [V4<T>]),
    ) {
        let form = self.step_coefficients(implicit, h, last);
        let stride = T::from_f64(form.end_scale);
        let (u, v) = next;
        let next = (&mut *u, &mut *v);
        let TrialState {
            delta,
            velocities: speed,
            ..
        } = &mut self.best;
        let data = (Nodes(next.0), Nodes(next.1), Nodes(delta), Nodes(speed));
        scene
            .plan
            .for_each_chunk(data, &|_, nodes, (u, v, by, faster)| {
                for (n, i) in nodes.enumerate() {
                    let before = scene.at.v[i];
                    by.0[n] = scale(stride, by.0[n]);
                    // To w, or to 2w − v.
                    let change = scale(stride, sub(faster.0[n], before));
                    faster.0[n] = scale(scene.free[i], change);
                    u.0[n] = add_scaled(scene.at.u[i], T::ONE, by.0[n]);
                    v.0[n] = add_scaled(before, T::ONE, faster.0[n]);
                }
                []
            });
        let rigid = &mut self.rigid;
        if rigid.midpoint {
            rigid.extrapolate_end(form.gamma, scene.at.v, v);
        } else {
            for b in 0..rigid.bodies.len() {
                rigid.write_velocities(b, false, v);
            }
        }
        rigid.write_nodes(&rigid.best, u);
    }

    /// Stores the changes of velocity and displacement of the finished step.
    pub fn keep(&mut self, implicit: &mut LinearStepSolver<T>) {
        let [change, moved] = &mut implicit.solver.previous_solutions;
        std::mem::swap(change, &mut self.best.velocities);
        std::mem::swap(moved, &mut self.best.delta);
        implicit.solver.count = 2;
        self.rigid.commit();
    }

    fn scale_masses(&mut self, scene: &StepContext<'_, T>, gamma: f64) {
        let more = T::from_f64(1.0 + self.mass_damping * gamma);
        for (to, m) in self.masses.iter_mut().zip(scene.masses) {
            *to = more * *m;
        }
    }

    /// Sets the displacements at which damping is evaluated: for Euler at the start, for
    /// second-order schemes extrapolated to the evaluation time of their forces, to keep the order.
    fn freeze_damping(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) {
        if !terms.iter().any(|t| t.damped()) {
            return;
        }
        self.damping_displacements.clear();
        self.damping_displacements.extend_from_slice(scene.at.u);
        if self.rule != ImplicitScheme::Euler {
            let ahead = T::from_f64(form.evaluation_time);
            for (to, v) in self.damping_displacements.iter_mut().zip(scene.at.v) {
                *to = add_scaled(*to, ahead, *v);
            }
        }
        for term in terms {
            term.freeze_damping(scene.plan, &self.damping_displacements);
        }
    }

    /// Selects the guess with the lowest finite Φ, with nearby tools moved to the given fraction of
    /// their paths.
    fn start(
        &mut self,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        tools: Option<f64>,
    ) -> bool {
        let mut found = false;
        let mut led = 1.0;
        for guess in InitialGuess::ALL {
            if !self.guesses.has(guess) {
                continue;
            }
            let (guesses, trial) = (&self.guesses, &mut self.trial);
            let at = |i: usize| guesses.at(guess, scene, i);
            self.prescribed_fraction = 1.0;
            self.rigid.prescribed_fraction = 1.0;
            match guess {
                InitialGuess::AtRest => self.rigid.reset_trial(),
                _ => self.rigid.set_trial_from(at),
            }
            trial.set_displacement(scene, guesses, (form, self.mass_damping), &self.rigid, at);
            if let Some(share) = tools {
                self.truncate_guess(scene, terms, form, share);
            }
            let trial = &mut self.trial;
            // E is hardly ever negative, so a guess with too much inertia is skipped.
            if found && trial.inertia >= self.best.total() {
                continue;
            }
            trial.evaluate(
                scene,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                form,
            );
            let total = trial.total();
            if total.is_finite() && (!found || total < self.best.total()) {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                found = true;
                led = self.prescribed_fraction;
            }
        }
        self.prescribed_fraction = led;
        self.rigid.prescribed_fraction = led;
        found
    }

    /// Returns the coefficients for trials, with the current fraction of the prescribed motion.
    pub(in crate::physics::cpu) fn trial_coefficients(
        &self,
        form: StepCoefficients,
    ) -> (StepCoefficients, f64) {
        let reach = self.prescribed_fraction * form.evaluation_time;
        (
            StepCoefficients {
                evaluation_time: reach,
                ..form
            },
            self.mass_damping,
        )
    }

    /// Solves for the Newton direction. `None` if there is nothing to solve.
    pub(in crate::physics::cpu) fn solve(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        (first, goal): (f64, f64),
    ) -> Option<(f64, crate::physics::cpu::linear::cg::CgResult)> {
        let gamma = T::from_f64(form.gamma);
        let heavier = StepContext {
            masses: &self.masses,
            ..*scene
        };
        // The solver overwrites its right-hand side.
        self.forces.copy_from_slice(&implicit.solver.residual);
        loop {
            let projected = self.projected > 0;
            for term in terms.iter_mut() {
                term.set_psd_projection(projected);
            }
            let at = StateRef {
                u: &self.best.displacements,
                v: &self.best.velocities,
            };
            implicit.linearise(&heavier, terms, at, gamma);
            implicit.refresh_tied(terms, gamma);
            let (start, weight, definite) = implicit.build_block_jacobi(&heavier);
            let negligible = negligible_movement(scene.plan, &self.best.displacements);
            let floor = weight * (MIN_DIAGONAL_SHARE * negligible).powi(2);
            if definite && start <= floor {
                return None;
            }
            if definite || projected {
                if implicit.refresh(&heavier, terms, &self.best.displacements, gamma) {
                    implicit.basis.projected = projected;
                    implicit
                        .basis
                        .damping_displacements
                        .clone_from(&self.damping_displacements);
                    implicit.basis.poses.clear();
                    let poses = self.rigid.best.iter().map(|pose| pose.to_array());
                    implicit.basis.poses.extend(poses);
                }
                let matrix = SystemOperator {
                    plan: scene.plan,
                    masses: &self.masses,
                    free: scene.free,
                    terms,
                };
                // Inexact Newton forcing term: closer to the minimum, the solves must be more
                // accurate.
                let linear = self.step_settings.linear_tolerance;
                let nearer = if first > 0.0 {
                    (start / first).sqrt()
                } else {
                    1.0
                };
                let tolerance = match self.step_settings.tolerance > 0.0 {
                    true => linear
                        .min(nearer.max(1e-6))
                        .max(0.5 * (goal / start).sqrt()),
                    false => linear,
                };
                let stop = CgTolerance {
                    tolerance: tolerance.min(0.9),
                    floor,
                    max_iterations: implicit.settings.max_iterations,
                };
                let outcome = implicit.solve_afresh(&matrix, start, stop);
                let good = !outcome.indefinite
                    && outcome.predicted_decrease > 0.0
                    && implicit.has_coarse();
                if good || projected {
                    self.projected = self.projected.saturating_sub(1);
                    return Some((start, outcome));
                }
            }
            self.projected = PROJECTED_SOLVES;
            implicit.drop_coarse_space();
            implicit.solver.residual.copy_from_slice(&self.forces);
        }
    }

    /// Rebuilds the coarse space of a restored state.
    pub fn resume(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        basis: super::linear_step::CoarseSpaceState<T>,
    ) {
        self.scale_masses(scene, basis.h.to_f64());
        self.projected = basis.projected_solves_left;
        for term in terms.iter_mut() {
            term.set_psd_projection(basis.projected);
            if !basis.damping_displacements.is_empty() {
                term.freeze_damping(scene.plan, &basis.damping_displacements);
            }
        }
        let heavier = StepContext {
            masses: &self.masses,
            ..*scene
        };
        let poses: Vec<Pose> = basis.poses.iter().map(|p| Pose::from_array(*p)).collect();
        let projection = &mut implicit.solver.rigid_projection;
        self.rigid.update_projection(&poses, projection);
        implicit.resume(&heavier, terms, basis);
    }
}
