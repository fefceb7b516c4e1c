//! The iterations of Newton's method in one step, as a state machine.
//!
//! A round evaluates the residual, solves for a direction and searches along it:
//!
//! ```text
//! EvaluateResidual ─► [ResumeMotion] ─► CheckResidual ─► Solve ─► Search ─► CheckDecrease
//!        ▲                                    ▼             │        │            │
//!        │                             [UpdateFriction]     │        │            │
//!        └──────── NextRound ◄────────────────┴─────────────┴────────┴────────────┘──► Done
//! ```

use super::contact_iterations::{
    FRICTION_UPDATE_RESIDUAL_RATIO, MAX_BLOCKED_MOTION_ITERATIONS, MAX_FRICTION_UPDATES,
    MAX_ROUNDOFF_ITERATIONS, RESUME_RESIDUAL_RATIO,
};
use super::contact_terms::self_contact;
use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::{NewtonResult, NewtonSolver, PROJECTED_SOLVES};
use super::schemes::StepCoefficients;
use super::trial_state::has_inverted_tets;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;

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

/// What the iterations do next.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Evaluates the residual, and the goal below which it counts as converged.
    EvaluateResidual,
    /// Resumes prescribed motion that a collision had blocked.
    ResumeMotion,
    /// Compares the residual with the goal.
    CheckResidual,
    /// Updates the lagged normal forces of friction, at a small residual.
    UpdateFriction,
    /// Solves for the direction.
    Solve,
    /// Searches along the direction.
    Search(Direction),
    /// Checks by the decrease of Φ whether another round is needed.
    CheckDecrease(Direction, Decrease),
    /// Begins another round, if there may be one.
    NextRound,
    /// The step is found.
    Done,
}

/// A solved direction.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Direction {
    /// Squared residual that it started from.
    start: f64,
    /// Decrease of Φ that the quadratic model predicts, doubled.
    gain: f64,
    /// Rounding error of Φ.
    slack: f64,
}

/// The result of a line search.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decrease {
    /// Length, in directions.
    length: f64,
    /// Decrease of Φ.
    fall: f64,
}

/// The iterations of one step, from the state `best` of the solver.
pub(super) struct NewtonIterations<'a, T: Real> {
    newton: &'a mut NewtonSolver<T>,
    implicit: &'a mut LinearStepSolver<T>,
    scene: &'a StepContext<'a, T>,
    terms: &'a mut [Box<dyn Term<T>>],
    form: StepCoefficients,
    /// Whether contact is near.
    contact: bool,
    round: u32,
    /// Number of rounds after which the step is accepted unless it inverts tetrahedra.
    max_rounds: u32,
    /// Squared residual in the current round, and the goal.
    residual: f64,
    goal: f64,
    /// Squared residual before the first solve.
    first: f64,
    /// Whether prescribed motion was resumed in this round.
    motion_resumed: bool,
    /// Whether prescribed motion resumes in the next round regardless of the residual.
    resume_motion: bool,
    friction_updates: u32,
    roundoff_iterations: u32,
    /// Largest predicted decrease of Φ so far.
    best_gain: f64,
    /// Whether no tetrahedron is inverted at the start, once known.
    starts_uninverted: Option<bool>,
    result: NewtonResult,
}

impl<'a, T: Real> NewtonIterations<'a, T> {
    /// Prepares the iterations of a step with coefficients `form`, with contact near or not.
    pub fn new(
        newton: &'a mut NewtonSolver<T>,
        implicit: &'a mut LinearStepSolver<T>,
        scene: &'a StepContext<'a, T>,
        terms: &'a mut [Box<dyn Term<T>>],
        (form, contact): (StepCoefficients, bool),
    ) -> NewtonIterations<'a, T> {
        let iterations = newton.step_settings.iterations;
        let max_rounds = match newton.prescribed_fraction < 1.0 {
            true => iterations.max(MAX_BLOCKED_MOTION_ITERATIONS),
            false => iterations.max(1),
        };
        NewtonIterations {
            newton,
            implicit,
            scene,
            terms,
            form,
            contact,
            round: 0,
            max_rounds,
            residual: f64::INFINITY,
            goal: 0.0,
            first: 0.0,
            motion_resumed: false,
            resume_motion: false,
            friction_updates: 0,
            roundoff_iterations: 0,
            best_gain: 0.0,
            starts_uninverted: None,
            result: NewtonResult::default(),
        }
    }

    /// Iterates until the step is found. The iterations of linear solves before are `iterations`.
    pub fn run(mut self, iterations: u32) -> NewtonResult {
        self.result.iterations = iterations;
        let mut state = State::EvaluateResidual;
        while state != State::Done {
            state = match state {
                State::EvaluateResidual => self.evaluate_residual(),
                State::ResumeMotion => self.resume_motion(),
                State::CheckResidual => self.check_residual(),
                State::UpdateFriction => self.update_friction(),
                State::Solve => self.solve(),
                State::Search(direction) => self.search(direction),
                State::CheckDecrease(direction, found) => self.check_decrease(direction, found),
                State::NextRound => self.next_round(),
                State::Done => State::Done,
            };
        }
        self.result.elastic = self.newton.best.elastic;
        self.result
    }

    fn evaluate_residual(&mut self) -> State {
        self.motion_resumed = false;
        let mut scale = self.compute_residual();
        if self.contact {
            let (implicit, terms) = (&*self.implicit, &*self.terms);
            scale = scale.max(self.newton.contact_weight(implicit, terms, self.form));
        }
        self.residual = match self.round > 0 {
            true => self.implicit.preconditioned_norm_squared(self.scene.plan),
            false => f64::INFINITY,
        };
        let tolerance = self.newton.step_settings.tolerance;
        self.goal = (tolerance * tolerance) * scale;
        if self.friction_may_change() {
            self.goal *= FRICTION_UPDATE_RESIDUAL_RATIO;
        }
        let resumes = self.motion_is_blocked()
            && (std::mem::take(&mut self.resume_motion)
                || self.residual <= RESUME_RESIDUAL_RATIO * self.goal);
        match resumes {
            true => State::ResumeMotion,
            false => State::CheckResidual,
        }
    }

    fn resume_motion(&mut self) -> State {
        self.newton
            .advance_prescribed_motion(self.scene, self.terms, self.form);
        self.compute_residual();
        self.motion_resumed = true;
        State::CheckResidual
    }

    fn check_residual(&mut self) -> State {
        // The measure uses blocks of the previous step, which a resumed run does not have.
        if self.contact && self.round == 0 && self_contact(self.terms).is_some() {
            self.goal = 0.0;
        }
        let converged = self.round > 0 && !self.motion_resumed && self.residual <= self.goal;
        match converged {
            false => State::Solve,
            true if self.friction_may_change() => State::UpdateFriction,
            true => State::Done,
        }
    }

    fn update_friction(&mut self) -> State {
        self.friction_updates += 1;
        let newton = &mut *self.newton;
        if newton.update_friction(self.scene, self.terms, self.form) {
            self.compute_residual();
        } else {
            self.friction_updates = MAX_FRICTION_UPDATES;
        }
        State::NextRound
    }

    fn solve(&mut self) -> State {
        let solved = self.newton.solve(
            self.implicit,
            self.scene,
            self.terms,
            self.form,
            (self.first, self.goal),
        );
        let Some((start, outcome)) = solved else {
            return self.go_on_with_motion();
        };
        if self.round == 0 {
            self.first = start;
        }
        self.result.iterations += outcome.iterations;
        self.result.residual = outcome.residual;
        State::Search(Direction {
            start,
            gain: outcome.predicted_decrease / (self.form.gamma * self.form.gamma),
            slack: self.newton.best.rounding_error(),
        })
    }

    fn search(&mut self, direction: Direction) -> State {
        let Direction { gain, slack, .. } = direction;
        let found = self
            .newton
            .line_search(self.implicit, self.scene, self.terms, self.form, gain);
        match found {
            Some(_) if self.motion_resumed || self.motion_is_blocked() => State::NextRound,
            Some((length, fall)) => State::CheckDecrease(direction, Decrease { length, fall }),
            None => {
                // Exact blocks may give a bad direction; projected ones cannot, unless the contact
                // candidates changed.
                let astray = self.newton.projected == 0 || self.newton.candidates_changed;
                if (astray && gain > slack) || self.motion_resumed {
                    self.newton.projected = PROJECTED_SOLVES;
                    return State::NextRound;
                }
                self.go_on_with_motion()
            }
        }
    }

    fn check_decrease(&mut self, direction: Direction, found: Decrease) -> State {
        let Direction { start, gain, slack } = direction;
        let ratio = found.fall / (0.5 * gain);
        let trusted =
            found.length == 1.0 && ratio > MODEL_AGREEMENT && ratio < 1.0 / MODEL_AGREEMENT;
        self.roundoff_iterations += u32::from(gain <= slack);
        let spare = if self.contact {
            MAX_ROUNDOFF_ITERATIONS
        } else {
            0
        };
        if start <= self.goal || self.roundoff_iterations > spare {
            return State::Done;
        }
        self.best_gain = self.best_gain.max(gain);
        let by_energy = self.newton.step_settings.tolerance == 0.0;
        let last = self.round + 1 >= self.max_rounds;
        let near =
            trusted && (self.round == 0 || gain <= CONVERGED_DECREASE_RATIO * self.best_gain);
        let enough = by_energy && (trusted || self.round + 1 >= MAX_ITERATIONS_INVERTED_START);
        if !(enough || last) {
            return State::NextRound;
        }
        let wanted = (by_energy && !near && !last) || self.inverts_tets();
        match wanted && self.starts_uninverted() {
            true => State::NextRound,
            false => State::Done,
        }
    }

    fn next_round(&mut self) -> State {
        self.round += 1;
        match self.round < self.max_rounds.max(MAX_ITERATIONS_WHILE_INVERTING) {
            true => State::EvaluateResidual,
            false => State::Done,
        }
    }

    /// Goes on with blocked prescribed motion, if there is any: nothing else is left to do.
    fn go_on_with_motion(&mut self) -> State {
        self.resume_motion = self.motion_is_blocked();
        match self.resume_motion {
            true => State::NextRound,
            false => State::Done,
        }
    }

    /// Computes the residual of the best trial. Returns the squared reference value.
    fn compute_residual(&mut self) -> f64 {
        let newton = &mut *self.newton;
        newton.residual(self.implicit, self.scene, self.terms, self.form)
    }

    fn motion_is_blocked(&self) -> bool {
        self.newton.prescribed_fraction < 1.0
    }

    fn friction_may_change(&self) -> bool {
        self.contact && self.friction_updates < MAX_FRICTION_UPDATES
    }

    /// Whether tetrahedra are inverted at the evaluation time of the forces: at the end of the
    /// step, or for the midpoint rule at its middle.
    fn inverts_tets(&self) -> bool {
        has_inverted_tets(self.scene.plan, self.terms, &self.newton.best.displacements)
    }

    fn starts_uninverted(&mut self) -> bool {
        let (scene, terms) = (self.scene, &*self.terms);
        *self
            .starts_uninverted
            .get_or_insert_with(|| !has_inverted_tets(scene.plan, terms, scene.at.u))
    }
}
