//! The [`Simulator`] implementation of tetrahedral bodies stepped by rapier.

use super::body::{RapierBody, no_state};
use super::soft_body_model::SoftBodyModel;
use crate::gpu::{Gpu, Recorder};
use crate::mesh::{Blade, BoundaryFace, TetMesh, Topology};
use crate::physics::cpu::{
    StepFailure, Steppable, Worker, WorkerCommand, WorkerError, count_intersecting_faces,
    send_loads,
};
use crate::physics::loads::LoadVersions;
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    CgSettings, DiscreteModel, Energy, Engine, ExactPositions, ForceBalance, GrabId, GrabMode,
    Joint, Loads, NodePositions, NodeTerm, PrescribedMotionId, Reaction, Report,
    SelfContactSettings, Simulator, SimulatorState, SolverKind, StepCallback, StepProgress, Tool,
    ToolId, ToolPose, TopologyChange,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use std::collections::BTreeSet;
use std::sync::Arc;

/// A tetrahedral body that rapier steps on its own thread.
pub struct RapierTets {
    mesh: TetMesh,
    topology: Topology,
    network: DiscreteModel,
    loads: Loads,
    /// Versions of the loads that were sent to the worker.
    sent: Option<LoadVersions>,
    tools: Vec<Tool>,
    self_contact: Option<SelfContactSettings>,
    worker: Worker<RapierBody>,
    nodes: NodePositions,
    /// Version of the uploaded positions.
    shown: u64,
    /// Counts changes of state and shape from outside.
    changes: u64,
    progress: StepProgress,
}

impl RapierTets {
    /// A body of `mesh` with the masses and elements of `network`, at rest; `settings` gives the
    /// tolerance of the linear solves. `gpu` draws it.
    ///
    /// # Errors
    /// [`Error::Input`] if rapier does not support the model, or the scheme is not implicit;
    /// [`Error::Gpu`] if the nodes do not fit the device.
    pub fn new(
        gpu: &Gpu,
        (mesh, network): (TetMesh, DiscreteModel),
        (kind, settings): (SolverKind, CgSettings),
    ) -> Result<RapierTets> {
        check_kind(kind)?;
        if network.rest_positions.len() != mesh.nodes.len() {
            return Err(Error::Input(format!(
                "the model has {} nodes, but the mesh has {}",
                network.rest_positions.len(),
                mesh.nodes.len()
            )));
        }
        let topology = Topology::new(&mesh);
        let (matter, unit) = (
            SoftBodyModel::new(&network, &boundary(&mesh, &topology))?,
            network.length_unit,
        );
        let body = RapierBody::new(matter, network.masses.clone(), settings, unit)?;
        let nodes = NodePositions::new(gpu, &mesh)?;
        Ok(RapierTets {
            topology,
            loads: Loads::new(mesh.nodes.len(), nodes.frame(), unit),
            mesh,
            network,
            sent: None,
            tools: Vec::new(),
            self_contact: None,
            worker: Worker::new(Box::new(body)),
            nodes,
            shown: 0,
            changes: 0,
            progress: StepProgress::default(),
        })
    }

    /// Converts a worker error to the error of the step.
    fn error(&mut self, refusal: WorkerError) -> Error {
        match refusal {
            WorkerError::Wrong(error) => {
                // Rejected loads are sent again.
                self.sent = None;
                error
            }
            WorkerError::Failed(StepFailure::BadStep { h }, ..) => bad_step(h),
            WorkerError::Failed(failure, dt, progress) => {
                self.progress = progress;
                Error::Solver {
                    solver: "rapier",
                    step: progress.steps + 1,
                    time: progress.time,
                    cause: FailureCause::NotFinite,
                    what: failure.to_string(),
                    advice: format!(
                        "use a --dt below {dt}, less stiffness or more damping, or --engine cpu, and check the units of the mesh"
                    ),
                }
            }
        }
    }

    fn metres(&self, positions: &[DVec3]) -> Vec<DVec3> {
        let metres = positions.iter().map(|p| self.network.to_metres(*p));
        metres.collect()
    }

    /// Uploads the latest positions if they are new.
    fn upload(&mut self) -> Result<()> {
        let Some((version, positions)) = self.worker.published(self.shown) else {
            return Ok(());
        };
        self.shown = version;
        let places: Vec<DVec3> = positions.iter().map(|x| self.network.to_file(*x)).collect();
        self.nodes.set_positions(&places)
    }

    /// Uploads the present positions.
    fn show(&mut self) -> Result<()> {
        self.worker.publish();
        self.upload()
    }
}

/// The boundary faces by their nodes.
fn boundary(mesh: &TetMesh, topology: &Topology) -> Vec<[u32; 3]> {
    let faces = topology.boundary.iter();
    let nodes = |f: &BoundaryFace| topology.boundary_nodes(mesh, *f);
    faces.map(nodes).collect()
}

/// Rejects schemes that rapier does not support.
fn check_kind(kind: SolverKind) -> Result<()> {
    match kind {
        SolverKind::Implicit => Ok(()),
        kind => Err(Error::Input(format!(
            "rapier supports implicit Euler only, not {kind}; use --solver implicit or --engine cpu"
        ))),
    }
}

fn bad_step(dt: f64) -> Error {
    Error::Input(format!("time step must be finite and > 0, got {dt} s"))
}

impl Simulator for RapierTets {
    fn integrator(&self) -> SolverKind {
        SolverKind::Implicit
    }

    fn engine(&self) -> Engine {
        Engine::Rapier
    }

    fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn masses(&self) -> &[f64] {
        &self.network.masses
    }

    fn spring_pairs(&self) -> Vec<[u32; 2]> {
        self.network.springs.iter().map(|s| s.nodes).collect()
    }

    fn network(&self) -> Option<&DiscreteModel> {
        Some(&self.network)
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        check_kind(kind)?;
        self.worker.cancel_pending();
        self.progress = StepProgress::default();
        self.worker.set_progress(self.progress, Default::default());
        self.worker.body().set_settings(settings)?;
        self.changes += 1;
        self.show()
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(Error::Input(format!(
            "rapier does not support the term \"{}\"; for a floor, use a [[tool]] with a plane, or use --engine cpu",
            term.name()
        )))
    }

    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        tool.check()?;
        let place = self.network.to_metres(tool.pose.place());
        let place = ToolPose::new(place, tool.pose.turn());
        self.worker.body().add_tool(&tool, place)?;
        let id = self.loads.add_tool(tool.pose);
        self.tools.push(tool);
        self.changes += 1;
        Ok(id)
    }

    fn tools(&self) -> &[Tool] {
        &self.tools
    }

    fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<usize> {
        wanted.check()?;
        let mut body = self.worker.body();
        let through = count_intersecting_faces(
            &self.network,
            &boundary(&self.mesh, &self.topology),
            &body.positions(),
        )?;
        body.set_self_contact(wanted)?;
        drop(body);
        self.self_contact = Some(wanted);
        self.changes += 1;
        Ok(through)
    }

    fn self_contact(&self) -> Option<SelfContactSettings> {
        self.self_contact
    }

    fn add_joint(&mut self, joint: Joint) -> Result<()> {
        joint.check()?;
        let at = self.network.to_metres(joint.anchor);
        self.worker.body().add_joint(&joint, at)?;
        self.changes += 1;
        Ok(())
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        self.finish()?;
        Ok(self.worker.body().region_force(label))
    }

    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        self.finish()?;
        let nodes: BTreeSet<u32> = boundary(&self.mesh, &self.topology)
            .into_iter()
            .flatten()
            .collect();
        Ok(self.worker.body().tool_forces(&self.network, nodes))
    }

    fn forces(&mut self) -> Result<Vec<DVec3>> {
        send_loads(&self.loads, &mut self.sent, &mut self.worker)?;
        self.finish()?;
        Ok(self.worker.body().forces(&self.network))
    }

    fn add_prescribed_motion(&mut self, nodes: &[u32]) -> Result<PrescribedMotionId> {
        let positions = self.positions()?;
        let place = |v: &u32| positions.get(*v as usize).copied();
        let places: Option<Vec<DVec3>> = nodes.iter().map(place).collect();
        self.loads
            .add_prescribed_motion(nodes, &places.unwrap_or_default())
    }

    fn largest_stable_step(&self) -> Option<f64> {
        None
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        check_time_step(dt)?;
        send_loads(&self.loads, &mut self.sent, &mut self.worker)?;
        match steps {
            0 => Ok(()),
            steps => self.worker.enqueue(WorkerCommand::Steps(steps, dt)),
        }
    }

    fn set_waker(&mut self, waker: StepCallback) {
        self.worker.set_waker(waker);
    }

    fn progress(&mut self) -> Result<StepProgress> {
        self.progress = match self.worker.progress() {
            Ok(progress) => progress,
            Err(refusal) => return Err(self.error(refusal)),
        };
        Ok(self.progress)
    }

    fn finish(&mut self) -> Result<StepProgress> {
        self.progress = match self.worker.finish() {
            Ok(progress) => progress,
            Err(refusal) => return Err(self.error(refusal)),
        };
        Ok(self.progress)
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.run(steps, dt)?;
        self.update_nodes(work)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        Ok(Vec::new())
    }

    fn update_nodes(&mut self, _: &mut Recorder) -> Result<()> {
        self.upload()
    }

    fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let metres = self.worker.body().positions();
        Ok(metres.iter().map(|x| self.network.to_file(*x)).collect())
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        let unit = self.network.length_unit;
        let metres = self.worker.body().velocities();
        Ok(metres.iter().map(|v| *v / unit).collect())
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.nodes
            .check("positions", positions, |p| self.network.frame.to_local(p))?;
        let metres = self.metres(positions);
        {
            let mut body = self.worker.body();
            let velocities = body.velocities();
            body.set_state(&metres, &velocities)?;
        }
        self.changes += 1;
        self.show()
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let unit = self.network.length_unit;
        let velocities: Vec<DVec3> = velocities.iter().map(|v| *v * unit).collect();
        let mut body = self.worker.body();
        let positions = body.positions();
        body.set_state(&positions, &velocities)?;
        self.changes += 1;
        Ok(())
    }

    fn loads(&self) -> &Loads {
        &self.loads
    }

    fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        let positions = self.positions()?;
        self.loads
            .grab(&positions, |_| true, (centre, radius), grip)
    }

    fn cut(&mut self, _: &Blade) -> Result<TopologyChange> {
        Err(Error::Input(
            "rapier does not support cuts; use --engine cpu or gpu".into(),
        ))
    }

    fn report(&self) -> Result<Report> {
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        let energy = Energy::from_state(&self.network, &[], &positions, &velocities);
        Ok(Report::from_positions(energy, &self.mesh, &positions))
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        Ok(self.worker.body().force_balance(&self.network))
    }

    fn rms_speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.network.masses.iter().sum();
        let speed = (2.0 * self.progress.last.kinetic.max(0.0) / mass).sqrt();
        speed / (self.network.frame.scale * self.network.length_unit)
    }

    fn change_count(&self) -> u64 {
        self.changes + self.loads.version()
    }

    fn has_state(&self) -> bool {
        false
    }

    fn state(&self) -> Result<SimulatorState> {
        Err(no_state())
    }

    fn set_state(&mut self, _: &SimulatorState) -> Result<()> {
        Err(no_state())
    }

    fn pose(&self) -> Result<ExactPositions> {
        Err(no_state())
    }

    fn set_pose(&mut self, _: &ExactPositions) -> Result<()> {
        Err(no_state())
    }
}
