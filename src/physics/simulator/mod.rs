//! The common interface of all simulated bodies, independent of model and engine.

pub(super) mod capability;
pub(super) mod checkpoint;
pub(super) mod contact;
pub(super) mod engine;
pub(super) mod gradients;
pub(super) mod helpers;
pub(super) mod joints;
pub(super) mod member;
pub(super) mod messages;
pub(super) mod node_positions;
pub(super) mod progress;
pub(super) mod reactions;
pub(super) mod report;
pub(super) mod scaled_loads;
pub(super) mod state;
pub(super) mod time_step;

use super::{
    Capability, CgSettings, Checkpointing, Contact, DiscreteModel, Engine, ForceBalance, GrabId,
    GrabMode, GrabbedNode, Gradients, Joints, Loads, Member, NodePositions, NodeTerm,
    PrescribedMotionId, Reactions, Report, ScaledLoads, SolverKind, StepProgress,
};
use crate::gpu::{Array, Recorder};
use crate::mesh::{Blade, TetCut, TetMesh, Topology};
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Callback invoked on a CPU body's thread whenever there are new positions to draw.
pub type StepCallback = Arc<dyn Fn() + Send + Sync>;

/// A body and its solver.
///
/// Positions are in file units, velocities in file units per second, forces in newtons; nodes are
/// those of [`Simulator::mesh`]. Steps are requested with [`Simulator::advance`];
/// [`Simulator::progress`] polls without waiting, and [`Simulator::finish`] waits. In between, a
/// body on the CPU continues by itself; one on the GPU is given its next steps by either call. When
/// a step fails, the remaining steps are dropped and the body keeps the state before that step (a
/// grid body: at most 256 steps earlier), which can still be read and drawn; changing state, loads
/// or pins clears the failure. Changed loads take effect with later steps.
///
/// Capabilities that only some bodies have are traits of their own, such as [`Contact`], given by
/// methods such as [`Simulator::contact`]. [`Capability::require`] makes an error of a missing one.
///
/// To draw the body, use [`Simulator::nodes`] after [`Simulator::update_nodes`]; their version
/// shows whether they have moved. A grid body on the GPU may be drawn before its last steps are
/// validated.
pub trait Simulator: Send {
    /// The integration scheme.
    fn integrator(&self) -> SolverKind;

    /// The engine that computes the steps.
    fn engine(&self) -> Engine;

    /// The drawn mesh at rest, after cuts.
    fn mesh(&self) -> &TetMesh;

    /// The topology of that mesh.
    fn topology(&self) -> &Topology;

    /// Masses of all simulated nodes, kg.
    fn masses(&self) -> &[f64];

    /// The two simulated nodes of each edge of a tetrahedral body, or of each spring of a grid body.
    fn edge_nodes(&self) -> Vec<[u32; 2]>;

    /// The discrete model of a tetrahedral body.
    fn model(&self) -> Option<&DiscreteModel> {
        None
    }

    /// Switches to another scheme, restarted from positions and velocities.
    ///
    /// # Errors
    /// [`Error::Input`] if the body does not support it.
    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()>;

    /// Adds an energy term.
    ///
    /// # Errors
    /// [`Error::Input`] if the body supports springs only.
    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(unsupported_term(&*term))
    }

    /// Prescribes the motion of nodes of the mesh from now on: [`Loads::set_prescribed_motion`]
    /// sets their positions, whatever the forces on them.
    ///
    /// # Errors
    /// [`Error::Input`] if a node does not exist or is already constrained, or the body does not
    /// support prescribed motion.
    fn add_prescribed_motion(&mut self, nodes: &[u32]) -> Result<PrescribedMotionId> {
        let _ = nodes;
        Err(Capability::PrescribedMotion.unsupported())
    }

    /// The largest stable step of its scheme at rest, s; `None` if any step is stable.
    fn largest_stable_step(&self) -> Option<f64>;

    /// Requests `steps` more steps of `dt` seconds. Waits only for steps recorded by
    /// [`Simulator::record`] before.
    ///
    /// # Errors
    /// [`Error::Input`] if the step is invalid; otherwise an error if the device rejects the work.
    fn advance(&mut self, steps: u32, dt: f64) -> Result<()>;

    /// Returns the known progress without waiting.
    ///
    /// # Errors
    /// [`Error::Solver`] if a step failed; the remaining steps are dropped.
    fn progress(&mut self) -> Result<StepProgress>;

    /// Waits for all requested steps.
    ///
    /// # Errors
    /// As [`Simulator::progress`].
    fn finish(&mut self) -> Result<StepProgress>;

    /// Sets a callback for completed steps that no call waits for, so that a window can sleep until
    /// then. A body on the GPU does not call it and must be polled.
    fn set_waker(&mut self, waker: StepCallback) {
        let _ = waker;
    }

    /// Requests steps and waits for them.
    ///
    /// # Errors
    /// As [`Simulator::advance`] and [`Simulator::finish`].
    fn run(&mut self, steps: u32, dt: f64) -> Result<StepProgress> {
        self.advance(steps, dt)?;
        self.finish()
    }

    /// Records steps into the caller's work, or computes them if they are not on the GPU; see
    /// [`Simulator::update_nodes`].
    ///
    /// # Errors
    /// As [`Simulator::advance`].
    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()>;

    /// Iterations of the latest steps, oldest first; empty for schemes without iterations.
    ///
    /// # Errors
    /// Errors of reading back.
    fn iterations(&self) -> Result<Vec<u32>>;

    /// Records the update of [`Simulator::nodes`] to the present configuration: interpolation from
    /// a cage, or an upload.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn update_nodes(&mut self, work: &mut Recorder) -> Result<()>;

    /// The nodes on the GPU, for drawing.
    fn nodes(&self) -> &NodePositions;

    /// The approximate node normals that its steps compute, packed, on the GPU, and those at rest;
    /// `None` if the renderer must compute the normals.
    ///
    /// # Errors
    /// Errors of reading back.
    fn normals(&mut self) -> Result<Option<(Array, Vec<u32>)>> {
        Ok(None)
    }

    /// The nodes held by a grab, by the mesh's node numbers.
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist.
    fn held_by(&self, grab: GrabId) -> Result<Vec<GrabbedNode>> {
        self.loads().grabbed_nodes(grab)
    }

    /// Reads back the node positions.
    ///
    /// # Errors
    /// Errors of reading back.
    fn positions(&self) -> Result<Vec<DVec3>>;

    /// Reads back the node velocities.
    ///
    /// # Errors
    /// Errors of reading back.
    fn velocities(&self) -> Result<Vec<DVec3>>;

    /// Sets the node positions.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of positions is wrong or one is not finite, or if the body's
    /// nodes cannot be moved.
    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()>;

    /// Sets the node velocities.
    ///
    /// # Errors
    /// As [`Simulator::set_positions`].
    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()>;

    /// Resets it to its rest configuration with zero velocities; loads stay.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn restart(&mut self) -> Result<()> {
        let rest = self.mesh().nodes.clone();
        self.set_positions(&rest)?;
        self.set_velocities(&vec![DVec3::ZERO; rest.len()])
    }

    /// Pins, forces, gravity and grabs on the simulated nodes.
    fn loads(&self) -> &Loads;

    /// Mutable access to [`Simulator::loads`]; changes take effect with the next step.
    fn loads_mut(&mut self) -> &mut Loads;

    /// Pins nodes of the mesh at their present positions.
    ///
    /// # Errors
    /// [`Error::Input`] if a node does not exist.
    fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        self.loads_mut().pin_nodes(nodes)
    }

    /// Sets the external force on every node of the mesh, N.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of forces is wrong or a force is not finite.
    fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.loads_mut().set_forces(forces)
    }

    /// Grabs the nodes within `radius` of `centre`. Reads the positions back once.
    ///
    /// # Errors
    /// [`Error::Input`] if there are no nodes there, or a number is out of range.
    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId>;

    /// Moves the target of a grab; its nodes follow with the next step.
    ///
    /// # Errors
    /// As [`Loads::set_target`].
    fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        self.loads_mut().set_target(grab, target)
    }

    /// Releases a grab. Returns the number of its nodes.
    ///
    /// # Errors
    /// As [`Loads::release`].
    fn release(&mut self, grab: GrabId) -> Result<usize> {
        self.loads_mut().release(grab)
    }

    /// Cuts the body along `blade` in its present configuration. Objects that draw it or are bound
    /// to it must apply the returned change; a blade that hits nothing changes nothing.
    ///
    /// # Errors
    /// As [`cut`](crate::mesh::cut()); [`Error::Input`] if the body cannot be cut.
    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange>;

    /// The simulated coarse body, if the mesh is embedded in a cage.
    fn coarse_body(&self) -> Option<&dyn Simulator> {
        None
    }

    /// The combined bodies, if it consists of several; otherwise empty.
    fn members(&self) -> &[Member] {
        &[]
    }

    /// Computes energies, volume and displacement from the state read back.
    ///
    /// # Errors
    /// Errors of reading back.
    fn report(&self) -> Result<Report>;

    /// Sets whether steps may invert tets of elements. By default a step on the CPU or the
    /// GPU that inverts tets of a body without inverted ones fails.
    fn set_inversion_allowed(&mut self, allowed: bool) {
        let _ = allowed;
    }

    /// Returns the balance of the static forces in the present configuration; `None` if the engine
    /// does not know it, such as with tools on the GPU.
    ///
    /// # Errors
    /// Errors of reading back.
    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        Ok(None)
    }

    /// Contact with tools and itself, of tetrahedral bodies of finite elements: on the CPU, by
    /// rapier, and, of tools only, on the GPU; `None` for other bodies.
    fn contact(&mut self) -> Option<&mut dyn Contact> {
        None
    }

    /// Forces on nodes and rigid regions, of tetrahedral bodies on the CPU or by rapier, and of
    /// several bodies that all have them; `None` for other bodies.
    fn reactions(&mut self) -> Option<&mut dyn Reactions> {
        None
    }

    /// Pressures and muscles, of tetrahedral bodies on the CPU; `None` for other bodies.
    fn scaled_loads(&mut self) -> Option<&mut dyn ScaledLoads> {
        None
    }

    /// Gradients of quantities by parameters, of tetrahedral bodies on the CPU; `None` for other
    /// bodies.
    fn gradients(&mut self) -> Option<&mut dyn Gradients> {
        None
    }

    /// Joints between rigid regions, of bodies stepped by rapier; `None` for other bodies.
    fn joints(&mut self) -> Option<&mut dyn Joints> {
        None
    }

    /// Saving and restoring of states, of bodies on the CPU and the GPU; `None` for bodies stepped
    /// by rapier, and several bodies with one of them.
    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        None
    }

    /// As [`Simulator::checkpoint`], to restore states.
    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        None
    }

    /// Root mean square speed after the last step known, in body sizes per second.
    fn rms_speed(&self) -> f64;

    /// Version number that increases with every change from outside: state, loads or topology.
    fn change_count(&self) -> u64;
}

/// Returns the error for an energy term on a grid body.
pub(in crate::physics) fn unsupported_term(term: &dyn NodeTerm) -> Error {
    Error::Input(format!(
        "a grid body does not support the term \"{}\", only springs; simulate tets",
        term.name()
    ))
}

/// Changes of a body by a cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopologyChange {
    /// Changes of its mesh.
    pub mesh: TetCut,
    /// Number of removed springs.
    pub springs: usize,
}

impl TopologyChange {
    /// Whether the cut changed nothing.
    pub fn is_empty(&self) -> bool {
        self.springs == 0 && self.mesh.is_empty()
    }
}

/// The exact positions of a body (bitwise).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExactPositions {
    /// Positions in the local frame.
    pub(crate) positions: Vec<[f32; 4]>,
    /// Packed normals, if its steps compute them.
    pub(crate) normals: Vec<u32>,
    /// Displacements of a body on the CPU, in its own numbering.
    pub(crate) displacements: Vec<[f64; 3]>,
    /// Positions of its members, if it is several bodies.
    pub(crate) parts: Vec<ExactPositions>,
}
