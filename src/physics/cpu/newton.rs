//! Implicit steps as minimisations, by Newton's method.
//!
//! The incremental potential of a step (Gast et al. 2015, "Optimization Integrator for Large Time
//! Steps", section 4) is, with δ from the start of the step and the rest as in [`super::rules`],
//!
//! Φ(δ) = ½ |δ − δ̂|²_M / γ² + E(x + δ) + γ (½ w·D w + ½ α |w|²_M), δ̂ = b + γ ṽ + γ² M⁻¹ f,
//!
//! D being lagged. Newton starts at the best of a few guesses, which is what decides how far one
//! iteration comes; the resting point x is among them, for from it any wreck recovers. The second
//! derivatives are exact as long as that goes well, and projected for a few solves where it does
//! not.

use super::cg::{Matrix, Stop};
use super::guesses::{Guess, Guesses};
use super::implicit::{Implicit, Scene};
use super::loads::Loads;
use super::newton_contact::{EASED, FAINT, LEADING, ROUGH, RUBS, touching};
use super::pool::{Nodes, Plan};
use super::potential::{Trial, inverted};
use super::real::Real;
use super::rigid::RigidBodies;
use super::rigid_pose::Pose;
use super::rules::{Form, Rule};
use super::terms::{At, Term};
use super::vectors::{V4, add_scaled, scale, sub, zero};
use crate::physics;

/// The share of what nodes of a body do together that each would do by itself, at least: stiff
/// bodies of many nodes move as a whole where no node alone would move by what shows.
const ALONE: f64 = 0.1;

/// Solves for which blocks are projected once exact ones failed.
pub(super) const PROJECTED: u32 = 8;

/// An iteration that lowered Φ by this part of what it should have, or by its inverse, is followed
/// by another.
const TRUST: f64 = 0.7;

/// After an iteration that failed of that, one more is needed as long as they promise to lower Φ by
/// more than this part of what the best of them did.
const NEAR: f64 = 0.02;

/// Iterations of a step at most that starts with tets inside out: these recover soonest by steps
/// that lose energy.
const WRECKED: u32 = 4;

/// Iterations of a step at most while it turns any tet inside out: what is may stay so for good.
const UNFOLDING: u32 = 40;

/// The minimisation of a step, and its vectors.
#[derive(Clone, Debug)]
pub struct Minimiser<T> {
    /// When it stops.
    pub settings: physics::Newton,
    /// The rule.
    pub rule: Rule,
    /// α, in local units.
    pub mass_damping: f64,
    /// Solves left for which blocks are projected.
    pub projected: u32,
    /// (1 + α γ) m.
    masses: Vec<T>,
    pub(super) guesses: Guesses<T>,
    pub(super) best: Trial<T>,
    pub(super) trial: Trial<T>,
    /// What damping is taken at.
    pub(super) lagged: Vec<V4<T>>,
    pub(super) forces: Vec<V4<T>>,
    /// What of the body is rigid.
    pub(super) rigid: RigidBodies,
    /// When the step under way stops.
    pub(super) goal: physics::Newton,
    /// Displacements on the way to a trial; none where nothing touches.
    pub(super) moved: Vec<V4<T>>,
    /// The part of their way in the step that nodes that are led have gone in trials: less than all
    /// where something is in their way.
    pub(super) led: f64,
    /// Whether the last line search chose other points to touch.
    pub(super) chose: bool,
}

/// What a step starts from besides the state.
#[derive(Clone, Copy)]
pub struct Outside<'a, T> {
    /// What acts from outside.
    pub loads: &'a Loads<T>,
    /// Inverse masses; 0 for nodes that stay.
    pub inverse: &'a [T],
    /// Length of the step before, local units; 0 for none.
    pub last: f64,
}

/// How a minimisation went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Descent {
    /// Iterations of conjugate gradients.
    pub iterations: u32,
    /// The residual at the end of the last linear solve, over that at its start.
    pub residual: f64,
    /// The energy of the terms where forces are taken.
    pub elastic: f64,
}

impl<T: Real> Minimiser<T> {
    /// For a body shared out by `plan`, by `rule`.
    pub fn new(
        plan: &Plan,
        (settings, rule): (physics::Newton, Rule),
        mass_damping: f64,
    ) -> Minimiser<T> {
        let nodes = plan.nodes();
        Minimiser {
            settings,
            rule,
            mass_damping,
            projected: 0,
            masses: vec![T::ZERO; nodes],
            guesses: Guesses::new(nodes),
            best: Trial::new(nodes),
            trial: Trial::new(nodes),
            lagged: Vec::new(),
            forces: vec![zero(); nodes],
            rigid: RigidBodies::default(),
            goal: settings,
            moved: Vec::new(),
            led: 1.0,
            chose: false,
        }
    }

    /// What a step of `h` is by the rule, after what `implicit` remembers.
    fn form(&self, implicit: &Implicit<T>, h: f64, last: f64) -> Form {
        let known = if implicit.solver.count == 2 {
            last
        } else {
            0.0
        };
        self.rule.form(h, known)
    }

    /// Finds δ. `None` where no guess has an energy that is a number.
    pub fn step(
        &mut self,
        implicit: &mut Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        outside: Outside<'_, T>,
        h: f64,
    ) -> Option<Descent> {
        let form = self.form(implicit, h, outside.last);
        self.weigh_masses(scene, form.gamma);
        self.lag(scene, terms, form);
        let known = &implicit.solver.known;
        let history = (implicit.solver.count == 2).then_some(known);
        self.rigid.midpoint = self.rule == Rule::Midpoint;
        if outside.last == 0.0 {
            self.rigid.restart();
        }
        let rigid = &self.rigid;
        self.guesses.prepare(scene, outside, history, form, rigid);
        let mut stages = self.begin_contact(implicit, scene, terms, form);
        let first = 1.0 / f64::from(stages.max(1));
        let touches = stages > 0 || touching(terms).is_some();
        if !self.start(scene, terms, form, touches.then_some(first)) {
            return None;
        }
        if self.cover(scene, terms) && stages == 0 {
            implicit.forget_couplings();
            stages = self.begin_near(implicit);
        }
        let share = |stage: u32| f64::from(stage) / f64::from(stages.max(1));
        let mut descent = Descent::default();
        for stage in 1..stages {
            let shares = [share(stage), share(stage + 1)];
            descent.iterations += self.advance_stage(implicit, scene, terms, form, shares);
        }
        let mut first = 0.0;
        let most = match self.led < 1.0 {
            true => self.goal.iterations.max(LEADING),
            false => self.goal.iterations.max(1),
        };
        let mut best_gain = 0.0f64;
        let (mut rubs, mut faint) = (0, 0);
        // Whether nodes that are led go on whatever the residual.
        let mut eased = false;
        // Whether no tet is inside out at the start, once that is known.
        let mut whole = None;
        for round in 0..most.max(UNFOLDING) {
            let mut went_on = false;
            let mut scale = self.residual(implicit, scene, terms, form);
            if stages > 0 {
                scale = scale.max(self.contact_weight(implicit, terms, form));
            }
            let before = if round > 0 {
                implicit.measure(scene.plan)
            } else {
                f64::INFINITY
            };
            let mut goal = (self.goal.tolerance * self.goal.tolerance) * scale;
            if stages > 0 && rubs < RUBS {
                goal *= ROUGH;
            }
            if self.led < 1.0 && (std::mem::take(&mut eased) || before <= EASED * goal) {
                self.lead_on(scene, terms, form);
                self.residual(implicit, scene, terms, form);
                went_on = true;
            }
            // Measured by blocks of the step before, which a run that is resumed does not have.
            if stages > 0 && round == 0 && touching(terms).is_some() {
                goal = 0.0;
            }
            if round > 0 && !went_on && before <= goal {
                if stages > 0 && rubs < RUBS {
                    rubs += 1;
                    if self.rub(scene, terms, form) {
                        self.residual(implicit, scene, terms, form);
                    } else {
                        rubs = RUBS;
                    }
                    continue;
                }
                break;
            }
            let Some((start, outcome)) = self.solve(implicit, scene, terms, form, (first, goal))
            else {
                eased = self.led < 1.0;
                if eased {
                    continue;
                }
                break;
            };
            if round == 0 {
                first = start;
            }
            descent.iterations += outcome.iterations;
            descent.residual = outcome.residual;
            let gain = outcome.gain / (form.gamma * form.gamma);
            let slack = self.best.slack();
            let Some((length, fall)) = self.search(implicit, scene, terms, form, gain) else {
                // Exact blocks may have led astray; projected ones cannot, but of other points.
                let astray = self.projected == 0 || self.chose;
                if (astray && gain > slack) || went_on {
                    self.projected = PROJECTED;
                    continue;
                }
                eased = self.led < 1.0;
                if eased {
                    continue;
                }
                break;
            };
            if went_on || self.led < 1.0 {
                continue;
            }
            let ratio = fall / (0.5 * gain);
            let trusted = length == 1.0 && ratio > TRUST && ratio < 1.0 / TRUST;
            faint += u32::from(gain <= slack);
            let spare = if stages > 0 { FAINT } else { 0 };
            if start <= goal || faint > spare {
                break;
            }
            best_gain = best_gain.max(gain);
            let by_energy = self.goal.tolerance == 0.0;
            let last = round + 1 >= most;
            let near = trusted && (round == 0 || gain <= NEAR * best_gain);
            let enough = by_energy && (trusted || round + 1 >= WRECKED);
            if !(enough || last) {
                continue;
            }
            let wanted = (by_energy && !near && !last) || self.folded(scene, terms);
            let at = scene.at.u;
            if !(wanted && *whole.get_or_insert_with(|| !inverted(scene.plan, terms, at))) {
                break;
            }
        }
        descent.elastic = self.best.elastic;
        Some(descent)
    }

    /// Whether tets are inside out where the step's forces are taken so far: at its end, by the
    /// midpoint rule in its middle.
    fn folded(&self, scene: &Scene<'_, T>, terms: &[Box<dyn Term<T>>]) -> bool {
        inverted(scene.plan, terms, &self.best.place)
    }

    /// Writes the state at the end of the step that was found.
    pub fn finish(
        &mut self,
        scene: &Scene<'_, T>,
        implicit: &Implicit<T>,
        (h, last): (f64, f64),
        next: (&mut [V4<T>], &mut [V4<T>]),
    ) {
        let form = self.form(implicit, h, last);
        let stride = T::of(form.stride);
        let (u, v) = next;
        let next = (&mut *u, &mut *v);
        let Trial { delta, speed, .. } = &mut self.best;
        let data = (Nodes(next.0), Nodes(next.1), Nodes(delta), Nodes(speed));
        scene.plan.each(data, &|_, nodes, (u, v, by, faster)| {
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
            rigid.reflect(form.gamma, scene.at.v, v);
        } else {
            for b in 0..rigid.bodies.len() {
                rigid.carry(b, false, v);
            }
        }
        rigid.put(&rigid.best, u);
    }

    /// Keeps the changes of velocity and displacement of the step that was finished.
    pub fn keep(&mut self, implicit: &mut Implicit<T>) {
        let [change, moved] = &mut implicit.solver.known;
        std::mem::swap(change, &mut self.best.speed);
        std::mem::swap(moved, &mut self.best.delta);
        implicit.solver.count = 2;
        self.rigid.keep();
    }

    fn weigh_masses(&mut self, scene: &Scene<'_, T>, gamma: f64) {
        let more = T::of(1.0 + self.mass_damping * gamma);
        for (to, m) in self.masses.iter_mut().zip(scene.masses) {
            *to = more * *m;
        }
    }

    /// Takes note of where damping is taken: Euler's at the start, of rules of second order as far
    /// on as their forces are, or they would not be of second order.
    fn lag(&mut self, scene: &Scene<'_, T>, terms: &mut [Box<dyn Term<T>>], form: Form) {
        if !terms.iter().any(|t| t.damped()) {
            return;
        }
        self.lagged.clear();
        self.lagged.extend_from_slice(scene.at.u);
        if self.rule != Rule::Euler {
            let ahead = T::of(form.reach);
            for (to, v) in self.lagged.iter_mut().zip(scene.at.v) {
                *to = add_scaled(*to, ahead, *v);
            }
        }
        for term in terms {
            term.lag(scene.plan, &self.lagged);
        }
    }

    /// Takes the guess of the lowest Φ, if any has one that is a number, where tools that are near
    /// have gone that share of their way.
    fn start(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        tools: Option<f64>,
    ) -> bool {
        let mut found = false;
        let mut led = 1.0;
        for guess in Guess::ALL {
            if !self.guesses.has(guess) {
                continue;
            }
            let (guesses, trial) = (&self.guesses, &mut self.trial);
            let at = |i: usize| guesses.at(guess, scene, i);
            self.led = 1.0;
            self.rigid.led = 1.0;
            match guess {
                Guess::Still => self.rigid.stay(),
                _ => self.rigid.guess(at),
            }
            trial.put(scene, guesses, (form, self.mass_damping), &self.rigid, at);
            if let Some(share) = tools {
                self.fit(scene, terms, form, share);
            }
            let trial = &mut self.trial;
            // E is hardly ever negative: one that is too far off already is not looked at.
            if found && trial.inertia >= self.best.total() {
                continue;
            }
            trial.weigh(scene, terms, &self.lagged, &mut self.forces, form);
            let total = trial.total();
            if total.is_finite() && (!found || total < self.best.total()) {
                std::mem::swap(&mut self.best, &mut self.trial);
                self.rigid.accept();
                found = true;
                led = self.led;
            }
        }
        self.led = led;
        self.rigid.led = led;
        found
    }

    /// What trials are put by: with nodes that are led as far as they have gone.
    pub(super) fn how(&self, form: Form) -> (Form, f64) {
        let reach = self.led * form.reach;
        (Form { reach, ..form }, self.mass_damping)
    }

    /// Solves for the direction. `None` where there is nothing to solve.
    pub(super) fn solve(
        &mut self,
        implicit: &mut Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: Form,
        (first, goal): (f64, f64),
    ) -> Option<(f64, super::cg::Outcome)> {
        let gamma = T::of(form.gamma);
        let heavier = Scene {
            masses: &self.masses,
            ..*scene
        };
        // The solver leaves nothing of what it solved for.
        self.forces.copy_from_slice(&implicit.solver.residual);
        loop {
            let projected = self.projected > 0;
            for term in terms.iter_mut() {
                term.project(projected);
            }
            let at = At {
                u: &self.best.place,
                v: &self.best.speed,
            };
            implicit.linearise(&heavier, terms, at, gamma);
            implicit.refresh_tied(terms, gamma);
            let (start, weight, definite) = implicit.precondition(&heavier);
            let floor = weight * (ALONE * T::NEGLIGIBLE).powi(2);
            if definite && start <= floor {
                return None;
            }
            if definite || projected {
                if implicit.refresh(&heavier, terms, &self.best.place, gamma) {
                    implicit.basis.projected = projected;
                    implicit.basis.lagged.clone_from(&self.lagged);
                    implicit.basis.poses.clear();
                    let poses = self.rigid.best.iter().map(Pose::numbers);
                    implicit.basis.poses.extend(poses);
                }
                let matrix = Matrix {
                    plan: scene.plan,
                    masses: &self.masses,
                    free: scene.free,
                    terms,
                };
                // Closer to the minimum the solves have to be closer, too.
                let linear = self.goal.linear;
                let nearer = if first > 0.0 {
                    (start / first).sqrt()
                } else {
                    1.0
                };
                let tolerance = match self.goal.tolerance > 0.0 {
                    true => linear
                        .min(nearer.max(1e-6))
                        .max(0.5 * (goal / start).sqrt()),
                    false => linear,
                };
                let stop = Stop {
                    tolerance: tolerance.min(0.9),
                    floor,
                    most: implicit.settings.max_iterations,
                };
                let outcome = implicit.solve_afresh(&matrix, start, stop);
                let good = !outcome.indefinite && outcome.gain > 0.0 && implicit.has_coarse();
                if good || projected {
                    self.projected = self.projected.saturating_sub(1);
                    return Some((start, outcome));
                }
            }
            self.projected = PROJECTED;
            implicit.forget_coarse();
            implicit.solver.residual.copy_from_slice(&self.forces);
        }
    }

    /// Makes the coarse space that a body's state tells of.
    pub fn resume(
        &mut self,
        implicit: &mut Implicit<T>,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        basis: super::implicit::Basis<T>,
    ) {
        self.weigh_masses(scene, basis.h.wide());
        self.projected = basis.left;
        for term in terms.iter_mut() {
            term.project(basis.projected);
            if !basis.lagged.is_empty() {
                term.lag(scene.plan, &basis.lagged);
            }
        }
        let heavier = Scene {
            masses: &self.masses,
            ..*scene
        };
        let poses: Vec<Pose> = basis.poses.iter().map(|p| Pose::of_numbers(*p)).collect();
        implicit.solver.tied.pose(&self.rigid, &poses);
        implicit.resume(&heavier, terms, basis);
    }
}
