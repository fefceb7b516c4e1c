//! Interface to the adjoint of the implicit steps of a body.

use super::energy_guard::StepFailure;
use super::static_adjoint::{AdjointSeed, AdjointSolution};
use super::steppable::{LoadUpdate, TetBody};
use crate::Result;
use crate::physics::cpu::contact::tool_contact::LocalToolPose;
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::vectors::V4;
use crate::physics::{DiscreteModel, NewtonSettings, StepRecord};
use glam::DVec3;

/// Parts of the reverse of a step, which is exact with all of them; tests leave parts out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::physics) struct StepParts {
    /// Velocities before the step.
    pub velocities: bool,
    /// The dependence of lagged damping on the positions and on the material.
    pub damping: bool,
    /// The dependence of explicit loads on the positions before the step.
    pub loads: bool,
    /// Displacement and change of velocity in the last step, in BDF2.
    pub history: bool,
    /// Hessians without projection.
    pub unprojected: bool,
    /// The exact Hessian of self-contact.
    pub pairs: bool,
    /// The dependence of friction on positions through its normal forces and normals.
    pub friction: bool,
}

impl MotionState {
    /// Amplitudes of pressures and muscles in the step to this state; empty for the first state.
    pub(in crate::physics) fn levels(&self) -> &[f64] {
        &self.step.levels
    }

    /// Returns this state with the constraints that the next step, with the loads `step`, begins
    /// with.
    pub(in crate::physics::cpu) fn with_constraints(&self, step: &StepLoads) -> MotionState {
        let mut start = self.clone();
        for (i, u, v) in &step.constrained {
            (start.u[*i], start.v[*i]) = (*u, *v);
        }
        if step.is_first {
            start.last = 0.0;
            start.change.clear();
            start.torques.fill(DVec3::ZERO);
        }
        start
    }
}

impl Default for StepParts {
    fn default() -> StepParts {
        StepParts {
            velocities: true,
            damping: true,
            loads: true,
            history: true,
            unprojected: true,
            pairs: true,
            friction: true,
        }
    }
}

/// Loads of one step that may differ from those of the step before, in the body's units and order.
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct StepLoads {
    /// Constrained soft nodes: slot, displacement at the start, and velocity.
    pub(in crate::physics::cpu) constrained: Vec<(usize, V4<f64>, V4<f64>)>,
    /// Whether the scheme restarted.
    pub(in crate::physics::cpu) is_first: bool,
    /// Poses of each tool at the start and at the end, and the duration of that motion.
    pub(in crate::physics::cpu) tools: Vec<[LocalToolPose; 2]>,
    pub(in crate::physics::cpu) time: f64,
    /// Amplitudes of pressures and muscles.
    pub levels: Vec<f64>,
}

/// State between two steps, in the body's units and order.
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct MotionState {
    pub(in crate::physics::cpu) u: Vec<V4<f64>>,
    pub(in crate::physics::cpu) v: Vec<V4<f64>>,
    /// Change of the velocities in the last step, if the scheme uses it.
    pub(in crate::physics::cpu) change: Vec<V4<f64>>,
    /// Length of the last step; 0 for none, or if the scheme does not use it.
    pub(in crate::physics::cpu) last: f64,
    /// What the step to this state had.
    pub(in crate::physics::cpu) step: StepLoads,
    /// Poses of rigid bodies, and the torques on them in the last step, for the midpoint rule.
    pub(in crate::physics::cpu) poses: Vec<Pose>,
    pub(in crate::physics::cpu) torques: Vec<DVec3>,
}

/// Derivatives of a quantity by a [`MotionState`].
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct StateAdjoint {
    pub(in crate::physics::cpu) u: Vec<V4<f64>>,
    pub(in crate::physics::cpu) v: Vec<V4<f64>>,
    /// By the change of the velocities and the displacement in the last step.
    pub(in crate::physics::cpu) change: Vec<V4<f64>>,
    pub(in crate::physics::cpu) moved: Vec<V4<f64>>,
    /// By the torques on rigid bodies in the last step.
    pub(in crate::physics::cpu) torques: Vec<DVec3>,
}

/// Derivatives of a quantity by what enters one step, in SI units and the network's node order.
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct StepAdjoint {
    /// Derivatives by forces, 1/N, and by what the engine alone knows.
    pub solution: AdjointSolution,
    /// Positions where the step evaluates its forces, m.
    pub positions: Vec<DVec3>,
    /// Force of inertia and mass damping over the mass of every node, m/s².
    pub inertia: Vec<DVec3>,
    /// Largest net force of the step over the largest force.
    pub residual: f64,
}

/// A body whose implicit steps have an adjoint.
pub(in crate::physics) trait MotionAdjoint: TetBody {
    /// Begins a motion, whose steps are solved to the tolerance of gradients. Returns its first
    /// state, and the settings before.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a body whose steps have no adjoint.
    fn begin_motion(&mut self) -> Result<(MotionState, NewtonSettings)>;

    /// Restores the settings of steps.
    fn end_motion(&mut self, own: NewtonSettings);

    /// Sets the loads of the next step, if they change. Returns those that it has.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for invalid loads, and if a tool is placed inside the
    /// body.
    fn begin_step(&mut self, change: Option<LoadUpdate>) -> Result<StepLoads>;

    /// Takes a step of `dt` seconds.
    fn motion_step(&mut self, dt: f64) -> std::result::Result<StepRecord, StepFailure>;

    /// The state after the last step, which had the loads `step`.
    fn motion_state(&self, step: StepLoads) -> MotionState;

    /// Bytes of a state.
    fn motion_state_bytes(&self) -> usize;

    /// Puts the body at a state, to measure it there; steps need a resumed body.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the body intersects itself there.
    fn show_state(&mut self, state: &MotionState) -> Result<()>;

    /// Adds `weight` times the derivatives of a quantity by the shown state to `adjoint`; returns
    /// those by what enters the quantity directly, at a weight of 1.
    fn add_quantity(
        &mut self,
        seed: &AdjointSeed,
        weight: f64,
        adjoint: &mut StateAdjoint,
    ) -> AdjointSolution;

    /// Turns the derivatives `adjoints` of several quantities by the state after a step of `dt` seconds into
    /// those by the state before it. `states` are both; `with` has the model of this body. Returns the
    /// derivatives of each by what enters the step.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the step is not at a strict minimum of its
    /// potential, or the solve does not converge.
    fn reverse_step(
        &mut self,
        states: [&MotionState; 2],
        dt: f64,
        with: (&DiscreteModel, &AdjointSeed, StepParts),
        adjoints: &mut [&mut StateAdjoint],
    ) -> Result<Vec<StepAdjoint>>;

    /// Returns the derivatives by the positions, 1/m, and by the velocities, s/m, of every node.
    fn by_state(&self, adjoint: &StateAdjoint) -> [Vec<DVec3>; 2];
}
