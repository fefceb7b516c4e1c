//! A body that is stepped on its own thread, with its mesh and its loads. The models of bodies
//! differ in [`BodyModel`] only.

use super::energy_guard::StepFailure;
use super::load_sync::send_loads;
use super::steppable::Steppable;
use super::worker::{Worker, WorkerError};
use crate::gpu::{Array, Gpu};
use crate::mesh::{Blade, LocalFrame, TetMesh, Topology};
use crate::physics::loads::LoadVersions;
use crate::physics::simulator::checkpoint::Checkpointing;
use crate::physics::simulator::contact::Contact;
use crate::physics::simulator::gradients::Gradients;
use crate::physics::simulator::joints::Joints;
use crate::physics::simulator::reactions::Reactions;
use crate::physics::simulator::scaled_loads::ScaledLoads;
use crate::physics::{
    CgSettings, DiscreteModel, Energy, Engine, ForceBalance, Loads, NodePositions, NodeTerm,
    SolverKind, StepProgress, TopologyChange,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use std::sync::Arc;

/// The model of a body stepped on its own thread: what differs between such bodies.
pub(in crate::physics) trait BodyModel: Sized + Send + 'static {
    /// The body that the worker steps.
    type Body: Steppable + ?Sized;

    /// The engine that computes the steps.
    const ENGINE: Engine;

    /// The integration scheme.
    fn integrator(&self) -> SolverKind;

    /// Name of the solver in errors.
    fn solver_name(&self) -> &'static str {
        self.integrator().name()
    }

    /// The frame from whose origin the body measures positions.
    fn frame(&self) -> LocalFrame;

    /// Metres per file unit.
    fn length_unit(&self) -> f64;

    /// Nodal masses, kg.
    fn masses(&self) -> &[f64];

    /// The discrete model of a tetrahedral body.
    fn discrete_model(&self) -> Option<&DiscreteModel> {
        None
    }

    /// The two nodes of each edge of a tetrahedral body, or of each spring of a grid body.
    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        let edges = self.discrete_model().map(DiscreteModel::edge_nodes);
        edges.into_iter().flatten().collect()
    }

    /// Whether node `i` belongs to the body.
    fn has_node(&self, i: usize) -> bool {
        let _ = i;
        true
    }

    /// Returns the energies, J, at these positions (file units) and velocities (file units/s).
    fn energy(&self, positions: &[DVec3], velocities: &[DVec3]) -> Energy;

    /// The largest stable step at rest, s; `None` if any step is stable.
    fn largest_stable_step(&self, loads: &Loads) -> Option<f64>;

    /// Returns the cause and the description of a failed step.
    fn describe_failure(&self, failure: &StepFailure) -> (FailureCause, String) {
        (failure.cause(), failure.to_string())
    }

    /// Returns what to do about a failed step of `dt` seconds.
    fn failure_advice(&self, dt: f64, loads: &Loads) -> String;

    /// Checks that the motion of these nodes can be prescribed.
    ///
    /// # Errors
    /// [`Error::Input`] if it cannot.
    fn check_prescribed_motion(&self, nodes: &[u32]) -> Result<()>;

    /// As [`Simulator::set_integrator`](crate::physics::Simulator::set_integrator).
    fn set_integrator(
        simulator: &mut ThreadedSimulator<Self>,
        kind: SolverKind,
        settings: CgSettings,
    ) -> Result<()>;

    /// As [`Simulator::add_term`](crate::physics::Simulator::add_term).
    fn add_term(simulator: &mut ThreadedSimulator<Self>, term: Arc<dyn NodeTerm>) -> Result<()>;

    /// As [`Simulator::set_positions`](crate::physics::Simulator::set_positions).
    fn set_positions(simulator: &mut ThreadedSimulator<Self>, positions: &[DVec3]) -> Result<()> {
        simulator.check_positions(positions)?;
        let metres = simulator.to_metres(positions);
        {
            let mut body = simulator.worker.body();
            let velocities = body.velocities();
            body.set_state(&metres, &velocities)?;
        }
        simulator.changes += 1;
        simulator.upload_now()
    }

    /// As [`Simulator::set_velocities`](crate::physics::Simulator::set_velocities).
    fn set_velocities(simulator: &mut ThreadedSimulator<Self>, velocities: &[DVec3]) -> Result<()> {
        let velocities = simulator.to_metres_per_second(velocities);
        let mut body = simulator.worker.body();
        let positions = body.positions();
        body.set_state(&positions, &velocities)?;
        simulator.changes += 1;
        Ok(())
    }

    /// As [`Simulator::cut`](crate::physics::Simulator::cut).
    fn cut(simulator: &mut ThreadedSimulator<Self>, blade: &Blade) -> Result<TopologyChange>;

    /// As [`Simulator::force_balance`](crate::physics::Simulator::force_balance).
    fn force_balance(simulator: &ThreadedSimulator<Self>) -> Result<Option<ForceBalance>>;

    /// As [`Simulator::set_inversion_allowed`](crate::physics::Simulator::set_inversion_allowed).
    fn set_inversion_allowed(simulator: &mut ThreadedSimulator<Self>, allowed: bool) {
        let _ = (simulator, allowed);
    }

    /// As [`Simulator::normals`](crate::physics::Simulator::normals).
    fn normals(simulator: &mut ThreadedSimulator<Self>) -> Result<Option<(Array, Vec<u32>)>> {
        let _ = simulator;
        Ok(None)
    }

    /// Uploads the normals of [`BodyModel::normals`] for new positions, if they were requested.
    ///
    /// # Errors
    /// An error if the device rejects the data.
    fn upload_normals(&self, worker: &Worker<Self::Body>) -> Result<()> {
        let _ = worker;
        Ok(())
    }

    /// The body's contact, if it supports contact.
    fn contact(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn Contact> {
        let _ = simulator;
        None
    }

    /// The body's inner forces, if they are known.
    fn reactions(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn Reactions> {
        let _ = simulator;
        None
    }

    /// The body's scaled loads, if it supports them.
    fn scaled_loads(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn ScaledLoads> {
        let _ = simulator;
        None
    }

    /// The body's gradients, if it has them.
    fn gradients(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn Gradients> {
        let _ = simulator;
        None
    }

    /// The body's joints, if it supports them.
    fn joints(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn Joints> {
        let _ = simulator;
        None
    }

    /// The body's checkpoints, if it supports them.
    fn checkpoint(simulator: &ThreadedSimulator<Self>) -> Option<&dyn Checkpointing> {
        let _ = simulator;
        None
    }

    /// As [`BodyModel::checkpoint`], to restore a state.
    fn checkpoint_mut(simulator: &mut ThreadedSimulator<Self>) -> Option<&mut dyn Checkpointing> {
        let _ = simulator;
        None
    }
}

/// A body of the model `M` on a worker thread. Positions for rendering are uploaded once per frame.
#[expect(
    private_bounds,
    reason = "users name it by the aliases of its models only"
)]
pub struct ThreadedSimulator<M: BodyModel> {
    pub(in crate::physics) model: M,
    pub(in crate::physics) mesh: TetMesh,
    pub(in crate::physics) topology: Topology,
    pub(in crate::physics) loads: Loads,
    /// Versions of the loads that the worker has.
    pub(in crate::physics) synced_loads: Option<LoadVersions>,
    pub(in crate::physics) worker: Worker<M::Body>,
    pub(in crate::physics) nodes: NodePositions,
    /// Version of the uploaded positions.
    uploaded_version: u64,
    /// Counter of external changes of state and shape.
    pub(in crate::physics) changes: u64,
    pub(in crate::physics) progress: StepProgress,
}

#[expect(private_bounds, reason = "as the type's")]
impl<M: BodyModel> ThreadedSimulator<M> {
    /// Creates the simulator of `body`, at rest, with the mesh and the model it was made of. `gpu`
    /// renders it.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the nodes do not fit the device.
    pub(in crate::physics) fn from_body(
        gpu: &Gpu,
        (mesh, model): (TetMesh, M),
        body: Box<M::Body>,
    ) -> Result<ThreadedSimulator<M>> {
        let nodes = NodePositions::new(gpu, &mesh)?;
        Ok(ThreadedSimulator {
            topology: Topology::new(&mesh),
            loads: Loads::new(mesh.nodes.len(), model.frame(), model.length_unit()),
            mesh,
            model,
            synced_loads: None,
            worker: Worker::new(body),
            nodes,
            uploaded_version: 0,
            changes: 0,
            progress: StepProgress::default(),
        })
    }

    /// Returns the boundary faces, by their nodes.
    pub(in crate::physics) fn boundary(&self) -> Vec<[u32; 3]> {
        self.topology.boundary_triangles(&self.mesh)
    }

    /// Converts positions from file units to metres from the origin of the frame.
    pub(in crate::physics) fn to_metres(&self, positions: &[DVec3]) -> Vec<DVec3> {
        let (origin, unit) = (self.model.frame().origin, self.model.length_unit());
        positions.iter().map(|p| (*p - origin) * unit).collect()
    }

    /// Converts positions from metres to file units; nodes that do not belong to the body keep
    /// their positions in the mesh.
    pub(in crate::physics) fn to_file_units(&self, metres: &[DVec3]) -> Vec<DVec3> {
        let (origin, unit) = (self.model.frame().origin, self.model.length_unit());
        let place = |(i, x): (usize, &DVec3)| match self.model.has_node(i) {
            true => origin + *x / unit,
            false => self.mesh.nodes[i],
        };
        metres.iter().enumerate().map(place).collect()
    }

    /// Converts velocities from file units/s to m/s.
    pub(in crate::physics) fn to_metres_per_second(&self, velocities: &[DVec3]) -> Vec<DVec3> {
        let unit = self.model.length_unit();
        velocities.iter().map(|v| *v * unit).collect()
    }

    /// Checks for one finite position per node.
    ///
    /// # Errors
    /// [`Error::Input`] otherwise.
    pub(in crate::physics) fn check_positions(&self, positions: &[DVec3]) -> Result<()> {
        let frame = self.model.frame();
        let local = |p| frame.to_local(p);
        self.nodes.check("positions", positions, local).map(|_| ())
    }

    /// Sends changed loads to the worker.
    ///
    /// # Errors
    /// [`Error::Input`] if no thread can be started.
    pub(in crate::physics) fn sync_loads(&mut self) -> Result<()> {
        send_loads(&self.loads, &mut self.synced_loads, &mut self.worker)
    }

    /// Uploads the latest published positions, if they are new.
    pub(super) fn upload(&mut self) -> Result<()> {
        let Some((version, positions)) = self.worker.published(self.uploaded_version) else {
            return Ok(());
        };
        self.uploaded_version = version;
        let places = self.to_file_units(&positions);
        self.nodes.set_positions(&places)?;
        self.model.upload_normals(&self.worker)
    }

    /// Uploads the current positions.
    pub(in crate::physics) fn upload_now(&mut self) -> Result<()> {
        self.worker.publish();
        self.upload()
    }

    /// Stores and returns the worker's answer.
    pub(super) fn store_progress(
        &mut self,
        answer: std::result::Result<StepProgress, WorkerError>,
    ) -> Result<StepProgress> {
        self.progress = answer.map_err(|refusal| self.step_error(refusal))?;
        Ok(self.progress)
    }

    /// Returns the error for a rejected command.
    fn step_error(&mut self, refusal: WorkerError) -> Error {
        match refusal {
            WorkerError::Wrong(error) => {
                // Rejected loads are sent again.
                self.synced_loads = None;
                error
            }
            WorkerError::Failed(failure @ StepFailure::BadStep { .. }, ..) => {
                Error::Input(failure.to_string())
            }
            WorkerError::Failed(failure, dt, progress) => {
                self.progress = progress;
                let (cause, what) = self.model.describe_failure(&failure);
                Error::Solver {
                    solver: self.model.solver_name(),
                    step: progress.steps + 1,
                    time: progress.time,
                    cause,
                    what,
                    advice: self.model.failure_advice(dt, &self.loads),
                }
            }
        }
    }
}
