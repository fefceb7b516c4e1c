//! Bodies as their workers and simulators see them, whatever numbers they compute in: code that is
//! generic over these would be compiled again by every program that uses the library.

use super::energy_guard::StepFailure;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::{
    DiscreteModel, Muscle, NodeTerm, SelfContactSettings, StepRecord, Tool, ToolPose,
};
use crate::{Error, Result};
use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The numbers that the CPU engine computes in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32: for speed.
    #[default]
    Single,
    /// f64: for truth.
    Double,
}

/// Where a tool is to be, in metres from the frame's origin, and how often it was put elsewhere
/// without going there.
pub(in crate::physics) type ToolTarget = (ToolPose, u64);

/// The loads that have changed.
#[derive(Debug, Default)]
pub(in crate::physics) struct LoadUpdate {
    pub gravity: DVec3,
    pub pinned: Option<Vec<bool>>,
    pub forces: Option<Vec<DVec3>>,
    pub attachments: Option<Vec<NodeConstraint>>,
    pub levels: Option<Vec<f64>>,
    pub tools: Option<Vec<ToolTarget>>,
}

/// What a worker steps.
pub(in crate::physics) trait Steppable: Send + 'static {
    /// Whether its steps are long and take iterations, each to be told of.
    fn has_long_steps(&self) -> bool;

    /// Takes steps of so many seconds; what is noted of the last.
    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure>;

    /// Steps taken.
    fn steps(&self) -> u64;

    /// Positions, m.
    fn positions(&self) -> Vec<DVec3>;

    /// Velocities, m/s.
    fn velocities(&self) -> Vec<DVec3>;

    /// Puts the nodes at positions (m) with velocities (m/s).
    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()>;

    /// Takes over loads.
    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()>;

    /// In how many parts its nodes are shared out.
    fn parts(&self) -> usize;

    /// The whole state, packed.
    fn serialise_state(&self) -> Result<Vec<u8>>;

    /// Goes on from a state that [`Steppable::serialise_state`] gave of a body made in the same way.
    fn resume(&mut self, packed: &[u8]) -> Result<()>;
}

/// A body of tets.
pub(in crate::physics::cpu) trait TetBody: Steppable {
    /// Adds a term on the nodes of `network`, which this body is.
    fn add_node_term(&mut self, term: Arc<dyn NodeTerm>, network: &DiscreteModel);

    /// Adds pressure on faces, three nodes each, at the level of this number.
    fn add_pressure(&mut self, faces: &[[u32; 3]], level: usize);

    /// Adds a muscle of `network`, which this body is, and its tets, at the level of this number.
    fn add_muscle(&mut self, muscle: &Muscle, level: usize, of: (&DiscreteModel, &[[u32; 4]]));

    /// Adds a tool that presses on the boundary faces of `network`, which this body is.
    fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &DiscreteModel);

    /// Has the body feel itself at the boundary faces of `network`, which it is; how many of these go
    /// through others.
    fn set_self_contact(
        &mut self,
        wanted: &SelfContactSettings,
        faces: &[[u32; 3]],
        network: &DiscreteModel,
    ) -> usize;

    /// The force on each tool, N, and its moment about the origin of the tool's shape, N·m.
    fn tool_forces(&self) -> Vec<[DVec3; 2]>;

    /// What all else of it exerts on each rigid body, N, and its moment about the centre of mass, N·m.
    fn rigid_forces(&self) -> Vec<[DVec3; 2]>;

    /// The sum of all forces on every node, N.
    fn forces(&self) -> Vec<DVec3>;

    /// Displacements from rest in the numbers that the body computes in.
    fn displacements(&self) -> Vec<[f64; 3]>;

    /// Puts the nodes where [`TetBody::displacements`] found them.
    fn set_displacements(&mut self, displacements: &[[f64; 3]]) -> Result<()>;
}

/// The particles of a grid.
pub(in crate::physics::cpu) trait GridParticles: Steppable {
    /// Takes over which springs there are.
    fn set_springs(&mut self, springs: &[u32]) -> Result<()>;

    /// The approximate normals of all particles, 0 where there is none.
    fn normals(&self) -> Vec<DVec3>;
}

/// The state as bytes.
pub(in crate::physics::cpu) fn pack(state: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(state).map_err(|e| Error::Input(format!("the state cannot be packed: {e}")))
}

/// The state that these bytes are.
pub(in crate::physics::cpu) fn unpack<S: DeserializeOwned>(packed: &[u8]) -> Result<S> {
    postcard::from_bytes(packed)
        .map_err(|_| Error::Input("the state of a body of other numbers, or a damaged one".into()))
}
