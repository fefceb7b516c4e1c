//! Traits of bodies for their workers and simulators, independent of the number type: code generic
//! over the number type would be compiled again by every program that uses the library.

use super::energy_guard::StepFailure;
use super::motion_adjoint::MotionAdjoint;
use super::static_adjoint::StaticAdjoint;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::pressure::LoadedFace;
use crate::physics::{
    DiscreteModel, ForceBalance, Muscle, NodeTerm, SelfContactSettings, StepRecord, Tool, ToolPose,
};
use crate::{Error, Result};
use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// Floating-point precision of the CPU engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32, the faster choice.
    #[default]
    Single,
    /// f64, the more accurate choice.
    Double,
}

/// Target pose of a tool, in metres from the frame's origin, and how often it was teleported.
pub(in crate::physics) type ToolTarget = (ToolPose, u64);

/// Loads that have changed.
#[derive(Debug, Default)]
pub(in crate::physics) struct LoadUpdate {
    pub gravity: DVec3,
    pub pinned: Option<Vec<bool>>,
    pub forces: Option<Vec<DVec3>>,
    pub attachments: Option<Vec<NodeConstraint>>,
    pub levels: Option<Vec<f64>>,
    pub tools: Option<Vec<ToolTarget>>,
}

/// A body that a worker steps.
pub(in crate::physics) trait Steppable: Send + 'static {
    /// Whether steps are long and iterative, so that each is reported.
    fn has_long_steps(&self) -> bool;

    /// Takes `steps` steps of `dt` seconds; returns the record of the last.
    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure>;

    /// Number of steps taken.
    fn steps(&self) -> u64;

    /// Positions, m.
    fn positions(&self) -> Vec<DVec3>;

    /// Velocities, m/s.
    fn velocities(&self) -> Vec<DVec3>;

    /// Sets the node positions (m) and velocities (m/s).
    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()>;

    /// Applies changed loads.
    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()>;
}

/// A body whose whole state can be saved and restored.
pub(in crate::physics) trait Resumable: Steppable {
    /// Number of chunks that its nodes are partitioned into.
    fn parts(&self) -> usize;

    /// Returns the whole state, serialised.
    fn serialise_state(&self) -> Result<Vec<u8>>;

    /// Restores a state from [`Resumable::serialise_state`] of a body made in the same way.
    fn resume(&mut self, packed: &[u8]) -> Result<()>;
}

/// A tetrahedral body.
pub(in crate::physics) trait TetBody: Resumable {
    /// Adds a term on the nodes of `network`, the model of this body.
    fn add_node_term(&mut self, term: Arc<dyn NodeTerm>, network: &DiscreteModel);

    /// Adds pressure on faces, three nodes each, with the amplitude of index `level`.
    fn add_pressure(&mut self, faces: &[LoadedFace], level: usize);

    /// Adds a muscle of `network`, the model of this body, and its tetrahedra, with the amplitude
    /// of index `level`.
    fn add_muscle(&mut self, muscle: &Muscle, level: usize, of: (&DiscreteModel, &[[u32; 4]]));

    /// Adds a tool in contact with the boundary faces of `network`, the model of this body.
    fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &DiscreteModel);

    /// Enables self-contact on the boundary faces of `network`, the model of this body; returns the
    /// number of faces that intersect others.
    fn set_self_contact(
        &mut self,
        wanted: &SelfContactSettings,
        faces: &[[u32; 3]],
        network: &DiscreteModel,
    ) -> usize;

    /// Returns the force on each tool, N, and its moment about the origin of the tool's shape, N·m.
    fn tool_forces(&self) -> Vec<[DVec3; 2]>;

    /// Returns the force of the rest of the body on each rigid body, N, and its moment about the
    /// centre of mass, N·m.
    fn rigid_forces(&self) -> Vec<[DVec3; 2]>;

    /// Returns the sum of all forces on every node, N.
    fn forces(&self) -> Vec<DVec3>;

    /// Returns the balance of the static forces; `stiffness` is that of each node, N/m.
    fn force_balance(&self, stiffness: &[f64]) -> ForceBalance;

    /// The adjoint of its equilibrium; `None` in single precision.
    fn static_adjoint(&mut self) -> Option<&mut dyn StaticAdjoint>;

    /// The adjoint of its steps; `None` in single precision.
    fn motion_adjoint(&mut self) -> Option<&mut dyn MotionAdjoint>;

    /// Sets whether steps may invert tets.
    fn set_inversion_allowed(&mut self, allowed: bool);

    /// Returns the displacements from rest in the body's own units and precision.
    fn displacements(&self) -> Vec<[f64; 3]>;

    /// Restores displacements from [`TetBody::displacements`].
    fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()>;
}

/// Particles of a grid.
pub(in crate::physics) trait GridParticles: Resumable {
    /// Replaces the set of springs.
    fn set_springs(&mut self, springs: &[u32]) -> Result<()>;

    /// Returns the approximate normals of all particles; 0 for a particle without one.
    fn normals(&self) -> Vec<DVec3>;
}

/// Serialises a state.
pub(in crate::physics::cpu) fn pack(state: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(state).map_err(|e| Error::Input(format!("cannot serialise the state: {e}")))
}

/// Deserialises a state.
pub(in crate::physics::cpu) fn unpack<S: DeserializeOwned>(packed: &[u8]) -> Result<S> {
    postcard::from_bytes(packed).map_err(|_| {
        Error::Input("the saved state is of a body of another precision, or damaged".into())
    })
}
