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
    FRICTION_UPDATE_RESIDUAL_RATIO, MAX_BLOCKED_MOTION_ITERATIONS, MAX_ROUNDOFF_ITERATIONS,
    RESUME_RESIDUAL_RATIO,
};
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
    predicted_decrease: f64,
    /// Rounding error of Φ.
    slack: f64,
}

/// The result of a line search.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decrease {
    /// Length, in directions.
    length: f64,
    /// Decrease of Φ.
    decrease: f64,
}

/// The iterations of one step, from the state `best` of the solver.
pub(super) struct NewtonIterations<'a, T: Real> {
    newton: &'a mut NewtonSolver<T>,
    linear_solver: &'a mut LinearStepSolver<T>,
    context: &'a StepContext<'a, T>,
    terms: &'a mut [Box<dyn Term<T>>],
    coefficients: StepCoefficients,
    /// Whether contact is near.
    contact: bool,
    round: u32,
    /// Number of rounds after which the step is accepted unless it inverts tetrahedra.
    max_rounds: u32,
    /// Squared residual in the current round, and at convergence.
    residual: f64,
    target_residual: f64,
    /// Squared residual before the first solve.
    first_residual: f64,
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
    /// Prepares the iterations of a step with coefficients `coefficients`, with contact near or
    /// not.
    pub fn new(
        newton: &'a mut NewtonSolver<T>,
        linear_solver: &'a mut LinearStepSolver<T>,
        context: &'a StepContext<'a, T>,
        terms: &'a mut [Box<dyn Term<T>>],
        (coefficients, contact): (StepCoefficients, bool),
    ) -> NewtonIterations<'a, T> {
        let iterations = newton.step_settings.iterations;
        let max_rounds = match newton.prescribed_fraction < 1.0 {
            true => iterations.max(MAX_BLOCKED_MOTION_ITERATIONS),
            false => iterations.max(1),
        };
        NewtonIterations {
            newton,
            linear_solver,
            context,
            terms,
            coefficients,
            contact,
            round: 0,
            max_rounds,
            residual: f64::INFINITY,
            target_residual: 0.0,
            first_residual: 0.0,
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
        loop {
            state = match state {
                // However far the step is solved: its friction has to be that of its own forces.
                State::Done if self.friction_must_converge() => State::UpdateFriction,
                State::Done => break,
                State::EvaluateResidual => self.evaluate_residual(),
                State::ResumeMotion => self.resume_motion(),
                State::CheckResidual => self.check_residual(),
                State::UpdateFriction => self.update_lagged_friction(),
                State::Solve => self.solve(),
                State::Search(direction) => self.search(direction),
                State::CheckDecrease(direction, found) => self.check_decrease(direction, found),
                State::NextRound => self.next_round(),
            };
        }
        self.result.elastic = self.newton.best.elastic;
        self.result
    }

    fn evaluate_residual(&mut self) -> State {
        self.motion_resumed = false;
        let mut scale = self.compute_residual();
        if self.contact {
            let (linear_solver, terms) = (&*self.linear_solver, &*self.terms);
            scale = scale.max(self.newton.contact_residual_scale(
                linear_solver,
                terms,
                self.coefficients,
            ));
        }
        self.residual = match self.round > 0 {
            true => self
                .linear_solver
                .preconditioned_norm_squared(self.context.plan),
            false => f64::INFINITY,
        };
        let tolerance = self.newton.step_settings.tolerance;
        self.target_residual = (tolerance * tolerance) * scale;
        if self.friction_may_change() {
            self.target_residual *= FRICTION_UPDATE_RESIDUAL_RATIO;
        }
        let resumes = self.motion_is_blocked()
            && (std::mem::take(&mut self.resume_motion)
                || self.residual <= RESUME_RESIDUAL_RATIO * self.target_residual);
        match resumes {
            true => State::ResumeMotion,
            false => State::CheckResidual,
        }
    }

    fn resume_motion(&mut self) -> State {
        self.newton
            .advance_prescribed_motion(self.context, self.terms, self.coefficients);
        self.compute_residual();
        self.motion_resumed = true;
        State::CheckResidual
    }

    fn check_residual(&mut self) -> State {
        // The measure uses blocks of the previous step, which a restored state does not have.
        if self.contact && self.round == 0 {
            self.target_residual = 0.0;
        }
        let converged =
            self.round > 0 && !self.motion_resumed && self.residual <= self.target_residual;
        match converged {
            false => State::Solve,
            true if self.friction_may_change() => State::UpdateFriction,
            true => State::Done,
        }
    }

    fn update_lagged_friction(&mut self) -> State {
        self.friction_updates += 1;
        self.roundoff_iterations = 0;
        let newton = &mut *self.newton;
        if newton.update_lagged_friction(self.context, self.terms, self.coefficients) {
            self.compute_residual();
        } else {
            self.friction_updates = u32::MAX;
        }
        State::NextRound
    }

    fn solve(&mut self) -> State {
        let solved = self.newton.solve(
            self.linear_solver,
            self.context,
            self.terms,
            self.coefficients,
            (self.first_residual, self.target_residual),
        );
        let Some((start, outcome)) = solved else {
            return self.resume_blocked_motion();
        };
        if self.round == 0 {
            self.first_residual = start;
        }
        self.result.iterations += outcome.iterations;
        self.result.residual = outcome.residual;
        State::Search(Direction {
            start,
            predicted_decrease: outcome.predicted_decrease
                / (self.coefficients.gamma * self.coefficients.gamma),
            slack: self.newton.best.rounding_error(),
        })
    }

    fn search(&mut self, direction: Direction) -> State {
        let Direction {
            predicted_decrease,
            slack,
            ..
        } = direction;
        let found = self.newton.line_search(
            self.linear_solver,
            self.context,
            self.terms,
            self.coefficients,
            predicted_decrease,
        );
        match found {
            Some(_) if self.motion_resumed || self.motion_is_blocked() => State::NextRound,
            Some((length, decrease)) => {
                State::CheckDecrease(direction, Decrease { length, decrease })
            }
            None => {
                // Exact blocks may give a bad direction; projected ones cannot, unless the contact
                // candidates changed.
                let may_be_wrong = self.newton.projected == 0 || self.newton.candidates_changed;
                if (may_be_wrong && predicted_decrease > slack) || self.motion_resumed {
                    self.newton.projected = PROJECTED_SOLVES;
                    return State::NextRound;
                }
                self.resume_blocked_motion()
            }
        }
    }

    fn check_decrease(&mut self, direction: Direction, found: Decrease) -> State {
        let Direction {
            start,
            predicted_decrease,
            slack,
        } = direction;
        let ratio = found.decrease / (0.5 * predicted_decrease);
        let trusted =
            found.length == 1.0 && ratio > MODEL_AGREEMENT && ratio < 1.0 / MODEL_AGREEMENT;
        self.roundoff_iterations += u32::from(predicted_decrease <= slack);
        let allowed_roundoff_iterations = if self.contact {
            MAX_ROUNDOFF_ITERATIONS
        } else {
            0
        };
        if start <= self.target_residual || self.roundoff_iterations > allowed_roundoff_iterations {
            return State::Done;
        }
        self.best_gain = self.best_gain.max(predicted_decrease);
        let by_energy = self.newton.step_settings.tolerance == 0.0;
        let is_last_round = self.round + 1 >= self.max_rounds;
        let has_converged = trusted
            && (self.round == 0 || predicted_decrease <= CONVERGED_DECREASE_RATIO * self.best_gain);
        let is_enough = by_energy && (trusted || self.round + 1 >= MAX_ITERATIONS_INVERTED_START);
        if !(is_enough || is_last_round) {
            return State::NextRound;
        }
        let needs_round = (by_energy && !has_converged && !is_last_round) || self.inverts_tets();
        match needs_round && self.starts_uninverted() {
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

    /// Resumes blocked prescribed motion, if any.
    fn resume_blocked_motion(&mut self) -> State {
        self.resume_motion = self.motion_is_blocked();
        match self.resume_motion {
            true => State::NextRound,
            false => State::Done,
        }
    }

    /// Computes the residual of the best trial. Returns the squared reference value.
    fn compute_residual(&mut self) -> f64 {
        let newton = &mut *self.newton;
        newton.residual(
            self.linear_solver,
            self.context,
            self.terms,
            self.coefficients,
        )
    }

    fn motion_is_blocked(&self) -> bool {
        self.newton.prescribed_fraction < 1.0
    }

    fn friction_must_converge(&self) -> bool {
        self.newton.is_exact() && self.newton.has_friction(self.terms) && self.friction_may_change()
    }

    fn friction_may_change(&self) -> bool {
        self.contact && self.friction_updates < self.newton.friction_limits().1
    }

    /// Whether tetrahedra are inverted at the evaluation time of the forces: at the end of the
    /// step, or for the midpoint rule at its middle.
    fn inverts_tets(&self) -> bool {
        has_inverted_tets(
            self.context.plan,
            self.terms,
            &self.newton.best.displacements,
        )
    }

    fn starts_uninverted(&mut self) -> bool {
        let (context, terms) = (self.context, &*self.terms);
        *self
            .starts_uninverted
            .get_or_insert_with(|| !has_inverted_tets(context.plan, terms, context.at.u))
    }
}
