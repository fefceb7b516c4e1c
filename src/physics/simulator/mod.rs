//! What everything that moves a body can do, whatever it is made of and whatever steps it.

pub(super) mod helpers;
pub(super) mod node_positions;
pub(super) mod progress;
pub(super) mod report;

use super::{
    AmplitudeId, BodiesState, CgSettings, CpuGridState, CpuState, DiscreteModel, Engine, GrabId,
    GrabMode, GrabbedNode, GridState, Joint, Loads, MultiBody, NodePositions, NodeTerm,
    PrescribedMotionId, Reaction, Report, ScaledLoad, SelfContactSettings, SolverKind,
    StepProgress, TetState, Tool, ToolId,
};
use crate::gpu::{Array, Recorder};
use crate::mesh::{Blade, TetCut, TetMesh, Topology};
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What is called by the thread of a body on the CPU whenever there are new positions to draw.
pub type StepCallback = Arc<dyn Fn() + Send + Sync>;

/// A body and what moves it.
///
/// Places are in file units, velocities in file units a second, forces in newtons; nodes are those
/// of [`Simulator::mesh`]. Steps are asked for with [`Simulator::advance`];
/// [`Simulator::progress`] looks how far they are, without waiting, and [`Simulator::finish`]
/// waits. A body on the CPU goes on by itself in between; one on the GPU is given its next steps by
/// either. When a step fails, those left are dropped and the body stays as it was before it (a grid
/// body: before the last 256 at most), and can still be read and drawn; changing state, loads or
/// pins clears the failure. What acts on the body is taken over with steps that come after.
///
/// Who draws the body takes [`Simulator::nodes`] after [`Simulator::update_nodes`]; their version tells
/// whether they have moved. A grid body on the GPU may be drawn before its last steps were found
/// sound.
pub trait Simulator: Send {
    /// By which scheme it steps.
    fn integrator(&self) -> SolverKind;

    /// What computes the steps.
    fn engine(&self) -> Engine;

    /// The mesh that is drawn, at rest, as cuts have left it.
    fn mesh(&self) -> &TetMesh;

    /// The neighbours in that mesh.
    fn topology(&self) -> &Topology;

    /// Mass of every node that is simulated, kg.
    fn masses(&self) -> &[f64];

    /// Which two of these nodes each spring ties.
    fn spring_pairs(&self) -> Vec<[u32; 2]>;

    /// Masses and springs, of a body of tets.
    fn network(&self) -> Option<&DiscreteModel> {
        None
    }

    /// Steps by another scheme from now on, afresh from positions and velocities.
    ///
    /// # Errors
    /// [`Error::Input`] for one that it does not have.
    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()>;

    /// Adds a term to its energy.
    ///
    /// # Errors
    /// [`Error::Input`] for a body that knows springs only.
    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(Error::Input(format!(
            "a {} cannot act on a grid body, which knows springs only; simulate tets",
            term.name()
        )))
    }

    /// Adds a pressure or a muscle, whose level is 0 until [`Simulator::set_amplitude`].
    ///
    /// # Errors
    /// [`Error::Input`] for what makes no sense for this body, and for all but a body of tets on
    /// the processor.
    fn add_scaled_load(&mut self, acting: ScaledLoad) -> Result<AmplitudeId> {
        Err(cpu_only_error(match acting {
            ScaledLoad::Pressure(_) => "pressure acts",
            ScaledLoad::Muscle(_) => "muscles act",
        }))
    }

    /// Sets the level of a pressure, Pa, or of a muscle, from 0 to 1; it acts from the next step
    /// on.
    ///
    /// # Errors
    /// [`Error::Input`] for a level that makes no sense, or of nothing that was added.
    fn set_amplitude(&mut self, id: AmplitudeId, level: f64) -> Result<()> {
        Err(Error::Input(format!(
            "nothing acts on this body at a level, so {id:?} cannot be set to {level}"
        )))
    }

    /// Adds a tool that presses on the body's boundary. [`Loads::set_tool_target`] says where it goes.
    ///
    /// # Errors
    /// [`Error::Input`] for a tool that makes no sense, and for all but a body of finite elements
    /// on the processor that `implicit` or `bdf2` steps.
    fn add_tool(&mut self, _: Tool) -> Result<ToolId> {
        Err(cpu_only_error("tools press"))
    }

    /// The tools, in the order in which they were added.
    fn tools(&self) -> &[Tool] {
        &[]
    }

    /// Has the body's boundary feel itself from now on: its parts each other, and its folds. Returns
    /// how many of its faces go through others, or are of parts that lie within others, as it is now;
    /// these are drawn apart and push nothing until they are free.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that make no sense, and for all but a body of finite elements on
    /// the processor that `implicit` or `bdf2` steps.
    fn set_self_contact(&mut self, _: SelfContactSettings) -> Result<usize> {
        Err(cpu_only_error("bodies feel themselves"))
    }

    /// The body's contact with itself, if it has any.
    fn self_contact(&self) -> Option<SelfContactSettings> {
        None
    }

    /// Joins two of its rigid regions, or one to the world, where they rest. Regions that are joined
    /// do not feel each other.
    ///
    /// # Errors
    /// [`Error::Input`] for a joint that makes no sense, regions that are not rigid, and for all but
    /// a body that rapier steps.
    fn add_joint(&mut self, _: Joint) -> Result<()> {
        Err(Error::Input(
            "rigid regions are joined by rapier only: take --engine rapier (a build with the feature `rapier`), or leave [[joint]] out".into(),
        ))
    }

    /// What the body exerts on each tool where it stands: the force, and its moment about the
    /// origin of the tool's shape. After the steps asked for.
    ///
    /// # Errors
    /// As [`Simulator::finish`].
    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        Ok(Vec::new())
    }

    /// What all else of the body exerts on the rigid region with this label where it stands, by contact
    /// and by what is soft around it: the force, and its moment about the region's centre of mass.
    /// None where there is no such region, or a GPU steps it. After the steps asked for.
    ///
    /// # Errors
    /// As [`Simulator::finish`].
    fn region_force(&mut self, _: i64) -> Result<Option<Reaction>> {
        Ok(None)
    }

    /// Leads nodes of the mesh along from now on: they are where [`Loads::set_prescribed_motion`] says, whatever
    /// pulls at them.
    ///
    /// # Errors
    /// [`Error::Input`] for nodes that are not there or held already, and for all but a body of
    /// tets on the processor.
    fn add_prescribed_motion(&mut self, nodes: &[u32]) -> Result<PrescribedMotionId> {
        Err(cpu_only_error(match nodes.len() {
            1 => "a node is led",
            _ => "nodes are led",
        }))
    }

    /// The largest stable step of its scheme at rest, s; none where any step is stable.
    fn largest_stable_step(&self) -> Option<f64>;

    /// Asks for `steps` more steps of `dt` seconds. Waits for nothing but steps that were recorded
    /// by [`Simulator::record`] before.
    ///
    /// # Errors
    /// [`Error::Input`] for a step that makes no sense; otherwise what the
    /// device refuses.
    fn advance(&mut self, steps: u32, dt: f64) -> Result<()>;

    /// How far the simulation is known to be, without waiting.
    ///
    /// # Errors
    /// [`Error::Solver`] when a step failed; the steps left are dropped.
    fn progress(&mut self) -> Result<StepProgress>;

    /// Waits for all steps asked for.
    ///
    /// # Errors
    /// As [`Simulator::progress`].
    fn finish(&mut self) -> Result<StepProgress>;

    /// Has `waker` called when steps were done that nobody waits for, so that a window sleeps until
    /// then; a body on the GPU has nobody who could call, and is to be looked at.
    fn set_waker(&mut self, waker: StepCallback) {
        let _ = waker;
    }

    /// Asks for steps and waits for them.
    ///
    /// # Errors
    /// As [`Simulator::advance`] and [`Simulator::finish`].
    fn run(&mut self, steps: u32, dt: f64) -> Result<StepProgress> {
        self.advance(steps, dt)?;
        self.finish()
    }

    /// Records steps into the caller's own work, or does them where they are not the GPU's; see
    /// [`Simulator::update_nodes`].
    ///
    /// # Errors
    /// As [`Simulator::advance`].
    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()>;

    /// Iterations that the latest steps took, oldest first; empty for schemes without any.
    ///
    /// # Errors
    /// What reading back gives.
    fn iterations(&self) -> Result<Vec<u32>>;

    /// Records what brings [`Simulator::nodes`] to where the body is: carrying, or an upload.
    ///
    /// # Errors
    /// What the device refuses.
    fn update_nodes(&mut self, work: &mut Recorder) -> Result<()>;

    /// The nodes on the GPU, for drawing.
    fn nodes(&self) -> &NodePositions;

    /// The approximate normals of the nodes that its steps make, packed, on the GPU, and those at
    /// rest; none where whoever draws makes them.
    ///
    /// # Errors
    /// What reading back gives.
    fn normals(&mut self) -> Result<Option<(Array, Vec<u32>)>> {
        Ok(None)
    }

    /// The force on every node of the mesh where the body stands, N: of what it is made of, with
    /// damping, of terms and of loads, but not of what holds nodes still; so on nodes that are held
    /// it is what the body exerts on that. Computed when asked for, after the steps asked for. NaN on
    /// nodes of rigid regions, of which only the sum is known.
    ///
    /// # Errors
    /// [`Error::Input`] for bodies that only the GPU knows the forces on, grids, and meshes that a
    /// cage carries.
    fn forces(&mut self) -> Result<Vec<DVec3>> {
        Err(Error::Input(
            "the forces on the nodes are known of a body of tets on the processor: --engine cpu, without [grid] or [cage]".into(),
        ))
    }

    /// What a grab holds, by the numbers of the mesh's nodes.
    ///
    /// # Errors
    /// [`Error::Input`] for a grab that is not there.
    fn held_by(&self, grab: GrabId) -> Result<Vec<GrabbedNode>> {
        self.loads().grabbed_nodes(grab)
    }

    /// Where the nodes are, read back.
    ///
    /// # Errors
    /// What reading back gives.
    fn positions(&self) -> Result<Vec<DVec3>>;

    /// Their velocities, read back.
    ///
    /// # Errors
    /// What reading back gives.
    fn velocities(&self) -> Result<Vec<DVec3>>;

    /// Moves the nodes.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of positions, one that is not
    /// finite, or a body whose nodes cannot be moved.
    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()>;

    /// Sets their velocities.
    ///
    /// # Errors
    /// As [`Simulator::set_positions`].
    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()>;

    /// Puts it back to where it rested, at rest; loads stay.
    ///
    /// # Errors
    /// What the device refuses.
    fn restart(&mut self) -> Result<()> {
        let rest = self.mesh().nodes.clone();
        self.set_positions(&rest)?;
        self.set_velocities(&vec![DVec3::ZERO; rest.len()])
    }

    /// Pins, forces, gravity and grabs on what is simulated.
    fn loads(&self) -> &Loads;

    /// As [`Simulator::loads`], to change them; they act from the next step on.
    fn loads_mut(&mut self) -> &mut Loads;

    /// Pins nodes of the mesh: they stay where they are.
    ///
    /// # Errors
    /// [`Error::Input`] for a node that does not exist.
    fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        self.loads_mut().pin_nodes(nodes)
    }

    /// Sets the external force on every node of the mesh, N.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of forces or one that is not
    /// finite.
    fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.loads_mut().set_forces(forces)
    }

    /// Grabs the nodes within `radius` of `centre`: reads the positions back once.
    ///
    /// # Errors
    /// [`Error::Input`] where there is nothing to grab, or for numbers that
    /// make no sense.
    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId>;

    /// Moves the target of a grab: its nodes follow with the next step.
    ///
    /// # Errors
    /// As [`Loads::set_target`].
    fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        self.loads_mut().set_target(grab, target)
    }

    /// Lets go of a grab's nodes. Returns how many they are.
    ///
    /// # Errors
    /// As [`Loads::release`].
    fn release(&mut self, grab: GrabId) -> Result<usize> {
        self.loads_mut().release(grab)
    }

    /// Cuts the body along `blade` where it stands now. Whoever draws it, or is bound to it,
    /// follows the change that is returned; a blade that hits nothing changes nothing.
    ///
    /// # Errors
    /// As [`cut`](crate::mesh::cut()); [`Error::Input`] for a body that
    /// cannot be cut.
    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange>;

    /// The coarse body that carries the mesh, if one does.
    fn coarse_body(&self) -> Option<&dyn Simulator> {
        None
    }

    /// The bodies that it is made of, if it is several.
    fn bodies(&self) -> Option<&MultiBody> {
        None
    }

    /// Energies, volume and displacement, read back.
    ///
    /// # Errors
    /// What reading back gives.
    fn report(&self) -> Result<Report>;

    /// Root mean square speed after the last step that is known of, in sizes of the body a second.
    fn rms_speed(&self) -> f64;

    /// A number that changes whenever the body is changed from outside: its state, its loads, its
    /// shape.
    fn change_count(&self) -> u64;

    /// Whether [`Simulator::state`] and [`Simulator::pose`] can be had of it.
    fn has_state(&self) -> bool {
        true
    }

    /// All that its next steps depend on, read back after the steps of [`Simulator::finish`]; of
    /// its shape only what is needed to tell it from another.
    ///
    /// # Errors
    /// What reading back gives; [`Error::Input`] where [`Simulator::has_state`] is not so.
    fn state(&self) -> Result<SimulatorState>;

    /// Puts it into a state that [`Simulator::state`] gave of it, or of one made and cut in the
    /// same way: the steps that follow are those that would have followed there.
    ///
    /// # Errors
    /// [`Error::Input`] for the state of another.
    fn set_state(&mut self, state: &SimulatorState) -> Result<()>;

    /// Where it stands, to the bit, as a cut finds it.
    ///
    /// # Errors
    /// What reading back gives.
    fn pose(&self) -> Result<ExactPositions>;

    /// Puts its nodes, without velocities, where a cut found them.
    ///
    /// # Errors
    /// [`Error::Input`] for the pose of another.
    fn set_pose(&mut self, pose: &ExactPositions) -> Result<()>;
}

fn cpu_only_error(what: &str) -> Error {
    Error::Input(format!(
        "{what} on a body of tets on the processor only: --engine cpu, without [grid] or [cage], and one body in the scene"
    ))
}

/// What a cut changed in a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopologyChange {
    /// In its mesh.
    pub mesh: TetCut,
    /// Springs that are no longer there.
    pub springs: usize,
}

impl TopologyChange {
    /// Whether nothing was hit, and nothing has changed.
    pub fn is_empty(&self) -> bool {
        self.springs == 0 && self.mesh.is_empty()
    }
}

/// Where a body stands, to the bit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExactPositions {
    /// Positions in the local frame.
    pub(crate) positions: Vec<[f32; 4]>,
    /// Packed normals, where its steps make them.
    pub(crate) normals: Vec<u32>,
    /// Displacements of a body on the CPU, in its own numbers.
    pub(crate) displacements: Vec<[f64; 3]>,
    /// Those of its bodies, where it is several.
    pub(crate) parts: Vec<ExactPositions>,
}

/// The state of a [`Simulator`]: see [`Simulator::state`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SimulatorState {
    /// Of a body of tets on the GPU.
    Tets(Box<TetState>),
    /// Of a grid body on the GPU.
    Grid(Box<GridState>),
    /// Of a body of tets on the CPU.
    Cpu(Box<CpuState>),
    /// Of a grid body on the CPU.
    CpuGrid(Box<CpuGridState>),
    /// Of several bodies.
    Bodies(Box<BodiesState>),
}
