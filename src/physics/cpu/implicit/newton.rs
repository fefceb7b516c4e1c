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
use crate::physics::cpu::node_constraints::Loads;
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
        self.prepare(implicit, scene, terms, outside, form);
        let stages = self.begin(implicit, scene, terms, form)?;
        let share = |stage: u32| f64::from(stage) / f64::from(stages.max(1));
        let mut iterations = 0;
        for stage in 1..stages {
            let shares = [share(stage), share(stage + 1)];
            iterations += self.advance_tool_stage(implicit, scene, terms, form, shares);
        }
        let with = (form, stages > 0);
        let newton = NewtonIterations::new(self, implicit, scene, terms, with);
        Some(newton.run(iterations))
    }

    /// Prepares the masses, the damping and the guesses of a step.
    fn prepare(
        &mut self,
        implicit: &LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        outside: StepInput<'_, T>,
        form: StepCoefficients,
    ) {
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
    }

    /// Begins contact and selects the best guess. Returns the number of stages of tool motion, 0 if
    /// no contact is near; `None` if no guess has a finite energy.
    fn begin(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
    ) -> Option<u32> {
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
        Some(stages)
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
