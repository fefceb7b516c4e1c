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

use super::contact_terms::self_contact;
use super::initial_guess::{InitialGuess, InitialGuesses};
use super::linear_step::{LinearStepSolver, StepContext};
use super::newton_iterations::NewtonIterations;
use super::schemes::{ImplicitScheme, StepCoefficients};
use super::trial_state::TrialState;
use crate::physics::NewtonSettings;
use crate::physics::cpu::external_loads::ExternalLoads;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{V4, add_scaled, scale, sub, zero};

/// Number of solves with projected blocks after exact ones failed.
pub(in crate::physics::cpu) const PROJECTED_SOLVES: u32 = 8;

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
    pub(super) masses: Vec<T>,
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
    pub loads: &'a ExternalLoads<T>,
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

    /// Returns the coefficients of a step of `h`, given the history in `linear_solver`.
    fn step_coefficients(
        &self,
        linear_solver: &LinearStepSolver<T>,
        h: f64,
        last: f64,
    ) -> StepCoefficients {
        let known = if linear_solver.solver.count == 2 {
            last
        } else {
            0.0
        };
        self.rule.coefficients(h, known)
    }

    /// Solves for δ. `None` if no guess has a finite energy.
    pub fn step(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        outside: StepInput<'_, T>,
        h: f64,
    ) -> Option<NewtonResult> {
        let coefficients = self.step_coefficients(linear_solver, h, outside.last);
        self.prepare(linear_solver, context, terms, outside, coefficients);
        let stages = self.begin(linear_solver, context, terms, coefficients)?;
        let share = |stage: u32| f64::from(stage) / f64::from(stages.max(1));
        let mut iterations = 0;
        for stage in 1..stages {
            let shares = [share(stage), share(stage + 1)];
            iterations +=
                self.advance_tool_stage(linear_solver, context, terms, coefficients, shares);
        }
        let with = (coefficients, stages > 0);
        let newton = NewtonIterations::new(self, linear_solver, context, terms, with);
        Some(newton.run(iterations))
    }

    /// Prepares the masses, the damping and the guesses of a step.
    fn prepare(
        &mut self,
        linear_solver: &LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        outside: StepInput<'_, T>,
        coefficients: StepCoefficients,
    ) {
        self.scale_masses(context, coefficients.gamma);
        self.freeze_damping(context, terms, coefficients);
        let known = &linear_solver.solver.previous_solutions;
        let history = (linear_solver.solver.count == 2).then_some(known);
        self.rigid.midpoint = self.rule == ImplicitScheme::Midpoint;
        if outside.last == 0.0 {
            self.rigid.clear_torques();
        }
        let rigid = &self.rigid;
        self.guesses
            .prepare(context, outside, history, coefficients, rigid);
    }

    /// Begins contact and selects the best guess. Returns the number of stages of tool motion, 0 if
    /// no contact is near; `None` if no guess has a finite energy.
    fn begin(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> Option<u32> {
        let mut stages = self.begin_contact(linear_solver, context, terms, coefficients);
        let first = 1.0 / f64::from(stages.max(1));
        let touches = stages > 0 || self_contact(terms).is_some();
        if !self.start(context, terms, coefficients, touches.then_some(first)) {
            return None;
        }
        if self.refresh_candidates(context, terms) && stages == 0 {
            linear_solver.drop_aggregate_pattern();
            stages = self.begin_contact_iterations(linear_solver);
        }
        Some(stages)
    }

    /// Writes the state at the end of the step.
    pub fn finish(
        &mut self,
        context: &StepContext<'_, T>,
        linear_solver: &LinearStepSolver<T>,
        (h, last): (f64, f64),
        next: (&mut [V4<T>], &mut [V4<T>]),
    ) {
        let coefficients = self.step_coefficients(linear_solver, h, last);
        let stride = T::from_f64(coefficients.end_scale);
        let (u, v) = next;
        let next = (&mut *u, &mut *v);
        let TrialState {
            delta,
            velocities: speed,
            ..
        } = &mut self.best;
        let data = (Nodes(next.0), Nodes(next.1), Nodes(delta), Nodes(speed));
        context
            .plan
            .for_each_chunk(data, &|_, nodes, (u, v, by, faster)| {
                for (n, i) in nodes.enumerate() {
                    let before = context.at.v[i];
                    by.0[n] = scale(stride, by.0[n]);
                    // To w, or to 2w − v.
                    let change = scale(stride, sub(faster.0[n], before));
                    faster.0[n] = scale(context.free[i], change);
                    u.0[n] = add_scaled(context.at.u[i], T::ONE, by.0[n]);
                    v.0[n] = add_scaled(before, T::ONE, faster.0[n]);
                }
                []
            });
        let rigid = &mut self.rigid;
        if rigid.midpoint {
            rigid.extrapolate_end(coefficients.gamma, context.at.v, v);
        } else {
            for b in 0..rigid.bodies.len() {
                rigid.write_velocities(b, false, v);
            }
        }
        rigid.write_nodes(&rigid.best, u);
    }

    /// Stores the changes of velocity and displacement of the finished step.
    pub fn keep(&mut self, linear_solver: &mut LinearStepSolver<T>) {
        let [change, moved] = &mut linear_solver.solver.previous_solutions;
        std::mem::swap(change, &mut self.best.velocities);
        std::mem::swap(moved, &mut self.best.delta);
        linear_solver.solver.count = 2;
        self.rigid.commit();
    }

    fn scale_masses(&mut self, context: &StepContext<'_, T>, gamma: f64) {
        let more = T::from_f64(1.0 + self.mass_damping * gamma);
        for (to, m) in self.masses.iter_mut().zip(context.masses) {
            *to = more * *m;
        }
    }

    /// Sets the displacements at which damping is evaluated: for Euler at the start, for
    /// second-order schemes extrapolated to the evaluation time of their forces, to keep the order.
    fn freeze_damping(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) {
        if !terms.iter().any(|t| t.damped()) {
            return;
        }
        self.damping_displacements.clear();
        self.damping_displacements.extend_from_slice(context.at.u);
        if self.rule != ImplicitScheme::Euler {
            let ahead = T::from_f64(coefficients.evaluation_time);
            for (to, v) in self.damping_displacements.iter_mut().zip(context.at.v) {
                *to = add_scaled(*to, ahead, *v);
            }
        }
        for term in terms {
            term.freeze_damping(context.plan, &self.damping_displacements);
        }
    }

    /// Selects the guess with the lowest finite Φ, with nearby tools moved to the given fraction of
    /// their paths.
    fn start(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        tools: Option<f64>,
    ) -> bool {
        let mut found = false;
        let mut prescribed_fraction = 1.0;
        for guess in InitialGuess::ALL {
            if !self.guesses.has(guess) {
                continue;
            }
            let (guesses, trial) = (&self.guesses, &mut self.trial);
            let at = |i: usize| guesses.at(guess, context, i);
            self.prescribed_fraction = 1.0;
            self.rigid.prescribed_fraction = 1.0;
            match guess {
                InitialGuess::AtRest => self.rigid.reset_trial(),
                _ => self.rigid.set_trial_from(at),
            }
            trial.set_displacement(
                context,
                guesses,
                (coefficients, self.mass_damping),
                &self.rigid,
                at,
            );
            if let Some(share) = tools {
                self.truncate_guess(context, terms, coefficients, share);
            }
            let trial = &mut self.trial;
            // E is hardly ever negative, so a guess with too much inertia is skipped.
            if found && trial.inertia >= self.best.total() {
                continue;
            }
            trial.evaluate(
                context,
                terms,
                &self.damping_displacements,
                &mut self.forces,
                coefficients,
            );
            let total = trial.total();
            if total.is_finite() && (!found || total < self.best.total()) {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept_trial();
                found = true;
                prescribed_fraction = self.prescribed_fraction;
            }
        }
        self.prescribed_fraction = prescribed_fraction;
        self.rigid.prescribed_fraction = prescribed_fraction;
        found
    }

    /// Returns the coefficients for trials, with the current fraction of the prescribed motion.
    pub(in crate::physics::cpu) fn trial_coefficients(
        &self,
        coefficients: StepCoefficients,
    ) -> (StepCoefficients, f64) {
        let reach = self.prescribed_fraction * coefficients.evaluation_time;
        (
            StepCoefficients {
                evaluation_time: reach,
                ..coefficients
            },
            self.mass_damping,
        )
    }

    /// Rebuilds the coarse space of a restored state.
    pub fn resume(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coarse_state: super::linear_step::CoarseSpaceState<T>,
    ) {
        self.scale_masses(context, coarse_state.h.to_f64());
        self.projected = coarse_state.projected_solves_left;
        for term in terms.iter_mut() {
            term.set_psd_projection(coarse_state.projected);
            if !coarse_state.damping_displacements.is_empty() {
                term.freeze_damping(context.plan, &coarse_state.damping_displacements);
            }
        }
        let heavier = StepContext {
            masses: &self.masses,
            ..*context
        };
        let poses: Vec<Pose> = coarse_state
            .poses
            .iter()
            .map(|p| Pose::from_array(*p))
            .collect();
        let projection = &mut linear_solver.solver.rigid_projection;
        self.rigid.update_projection(&poses, projection);
        linear_solver.resume(&heavier, terms, coarse_state);
    }
}
