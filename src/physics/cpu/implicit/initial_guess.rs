//! Initial guesses of Newton's method.

use super::linear_step::StepContext;
use super::newton::StepInput;
use super::schemes::StepCoefficients;
use crate::physics::cpu::partition::Nodes;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, add, add_scaled, scale, sub, zero};

/// An initial guess of the displacement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InitialGuess {
    /// The velocity changes as in the last step.
    ConstantAcceleration,
    /// The velocity is constant.
    ConstantVelocity,
    /// Inertia and external loads only: δ̂.
    InertialTarget,
    /// No displacement.
    AtRest,
}

impl InitialGuess {
    /// All guesses; those that are most often the best come first.
    pub const ALL: [InitialGuess; 4] = [
        InitialGuess::ConstantAcceleration,
        InitialGuess::ConstantVelocity,
        InitialGuess::InertialTarget,
        InitialGuess::AtRest,
    ];
}

/// Initial guesses of a step, and its inertial target.
#[derive(Clone, Debug)]
pub struct InitialGuesses<T> {
    /// δ̂.
    inertial_target: Vec<V4<T>>,
    /// b.
    history_offset: Vec<V4<T>>,
    /// Displacements of [`InitialGuess::ConstantAcceleration`].
    curved: Vec<V4<T>>,
    has_history: bool,
    evaluation_time: T,
}

impl<T: Real> InitialGuesses<T> {
    /// Allocates guesses for `nodes` nodes.
    pub fn new(nodes: usize) -> InitialGuesses<T> {
        InitialGuesses {
            inertial_target: vec![zero(); nodes],
            history_offset: vec![zero(); nodes],
            curved: vec![zero(); nodes],
            has_history: false,
            evaluation_time: T::ZERO,
        }
    }

    /// Prepares a step from `context`, where `history` is the last change of velocities and
    /// displacements.
    pub fn prepare(
        &mut self,
        context: &StepContext<'_, T>,
        outside: StepInput<'_, T>,
        history: Option<&[Vec<V4<T>>; 2]>,
        coefficients: StepCoefficients,
        rigid: &RigidBodies,
    ) {
        self.has_history = history.is_some() && coefficients.velocity_extrapolation > 0.0;
        self.evaluation_time = T::from_f64(coefficients.evaluation_time);
        let [gamma, back, reach, bend] = [
            coefficients.gamma,
            coefficients.history,
            coefficients.evaluation_time,
            coefficients.velocity_extrapolation,
        ]
        .map(T::from_f64);
        let data = (
            Nodes(&mut self.inertial_target),
            Nodes(&mut self.history_offset),
            Nodes(&mut self.curved),
        );
        context
            .plan
            .for_each_chunk(data, &|chunk, nodes, (goal, base, curved)| {
                let (masses, u) = (context.masses, context.at.u);
                outside
                    .loads
                    .write_forces(context.plan, chunk, masses, u, goal.0);
                for (b, body) in rigid.bodies.iter().enumerate() {
                    if nodes.contains(&body.nodes.start) {
                        rigid.transfer_surface_forces(b, nodes.start, goal.0);
                    }
                }
                for (n, i) in nodes.clone().enumerate() {
                    let mut v = context.at.v[i];
                    base.0[n] = zero();
                    if let Some([change, moved]) = history {
                        curved.0[n] = scale(reach, add_scaled(v, bend, change[i]));
                        base.0[n] = scale(back, moved[i]);
                        v = add_scaled(v, back, change[i]);
                    }
                    let by = scale(gamma, scale(outside.inverse[i], goal.0[n]));
                    let faster = add_scaled(v, T::ONE, by);
                    goal.0[n] = add_scaled(base.0[n], gamma, faster);
                }
                for (b, body) in rigid.bodies.iter().enumerate() {
                    if rigid.midpoint && nodes.contains(&body.nodes.start) {
                        let start = rigid.midpoint_start(b, context.at.v);
                        let places = rigid.inertial_target(b, coefficients.gamma, &start);
                        for (i, place) in body.proxy_nodes().zip(places) {
                            let goal = &mut goal.0[i - nodes.start];
                            let straight = scale(gamma, context.at.v[i]);
                            *goal = add(sub(*goal, straight), to_v4(place));
                        }
                    }
                }
                []
            });
    }

    /// Whether the guess is available.
    pub fn has(&self, guess: InitialGuess) -> bool {
        guess != InitialGuess::ConstantAcceleration || self.has_history
    }

    /// Returns the guess for node `i`.
    #[inline(always)]
    pub fn at(&self, guess: InitialGuess, context: &StepContext<'_, T>, i: usize) -> V4<T> {
        match guess {
            InitialGuess::ConstantAcceleration => self.curved[i],
            InitialGuess::ConstantVelocity => scale(self.evaluation_time, context.at.v[i]),
            InitialGuess::InertialTarget => self.inertial_target[i],
            InitialGuess::AtRest => zero(),
        }
    }

    /// Returns δ̂ of node `i`.
    #[inline(always)]
    pub fn goal(&self, i: usize) -> V4<T> {
        self.inertial_target[i]
    }

    /// Returns b of node `i`.
    #[inline(always)]
    pub fn base(&self, i: usize) -> V4<T> {
        self.history_offset[i]
    }
}
