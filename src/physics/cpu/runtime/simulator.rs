//! The [`Simulator`] implementation of bodies stepped on their own threads.

use super::steppable::Steppable;
use super::threaded_simulator::{BodyModel, ThreadedSimulator};
use super::worker::WorkerCommand;
use crate::Result;
use crate::gpu::{Array, Recorder};
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::simulator::capability::Capability;
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    AmplitudeId, CgSettings, DiscreteModel, Engine, ExactPositions, ForceBalance, GrabId, GrabMode,
    Joint, Loads, NodePositions, NodeTerm, PrescribedMotionId, Reaction, Report, ScaledLoad,
    SelfContactSettings, Simulator, SimulatorState, SolverKind, StepCallback, StepProgress, Tool,
    ToolId, TopologyChange,
};
use glam::DVec3;
use std::sync::Arc;

impl<M: BodyModel> Simulator for ThreadedSimulator<M> {
    fn integrator(&self) -> SolverKind {
        self.model.integrator()
    }

    fn engine(&self) -> Engine {
        M::ENGINE
    }

    fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn masses(&self) -> &[f64] {
        self.model.masses()
    }

    fn spring_pairs(&self) -> Vec<[u32; 2]> {
        self.model.spring_pairs()
    }

    fn network(&self) -> Option<&DiscreteModel> {
        self.model.discrete_model()
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        M::set_integrator(self, kind, settings)
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        M::add_term(self, term)
    }

    fn add_scaled_load(&mut self, acting: ScaledLoad) -> Result<AmplitudeId> {
        let missing = match acting {
            ScaledLoad::Pressure(_) => Capability::Pressure,
            ScaledLoad::Muscle(_) => Capability::Muscles,
        };
        let loads = M::scaled_loads(self).ok_or_else(|| missing.unsupported())?;
        loads.add_scaled_load(acting)
    }

    fn set_amplitude(&mut self, id: AmplitudeId, level: f64) -> Result<()> {
        let loads = M::scaled_loads(self).ok_or_else(|| Capability::Pressure.unsupported())?;
        loads.set_amplitude(id, level)
    }

    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        let contact = M::contact(self).ok_or_else(|| Capability::Tools.unsupported())?;
        contact.add_tool(tool)
    }

    fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<usize> {
        let contact = M::contact(self).ok_or_else(|| Capability::SelfContact.unsupported())?;
        contact.set_self_contact(wanted)
    }

    fn add_joint(&mut self, joint: Joint) -> Result<()> {
        let joints = M::joints(self).ok_or_else(|| Capability::Joints.unsupported())?;
        joints.add_joint(joint)
    }

    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        M::contact(self).map_or(Ok(Vec::new()), |contact| contact.tool_forces())
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        M::reactions(self).map_or(Ok(None), |forces| forces.region_force(label))
    }

    fn forces(&mut self) -> Result<Vec<DVec3>> {
        let forces = M::reactions(self).ok_or_else(|| Capability::NodalForces.unsupported())?;
        forces.nodal_forces()
    }

    fn add_prescribed_motion(&mut self, nodes: &[u32]) -> Result<PrescribedMotionId> {
        self.model.check_prescribed_motion(nodes)?;
        let positions = self.positions()?;
        let place = |v: &u32| positions.get(*v as usize).copied();
        let places: Option<Vec<DVec3>> = nodes.iter().map(place).collect();
        self.loads
            .add_prescribed_motion(nodes, &places.unwrap_or_default())
    }

    fn largest_stable_step(&self) -> Option<f64> {
        self.model.largest_stable_step(&self.loads)
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        check_time_step(dt)?;
        self.sync_loads()?;
        match steps {
            0 => Ok(()),
            steps => self.worker.enqueue(WorkerCommand::Steps(steps, dt)),
        }
    }

    fn set_waker(&mut self, waker: StepCallback) {
        self.worker.set_waker(waker);
    }

    fn progress(&mut self) -> Result<StepProgress> {
        let answer = self.worker.progress();
        self.store_progress(answer)
    }

    fn finish(&mut self) -> Result<StepProgress> {
        let answer = self.worker.finish();
        self.store_progress(answer)
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.run(steps, dt)?;
        self.update_nodes(work)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        Ok(self.worker.iterations())
    }

    fn update_nodes(&mut self, _: &mut Recorder) -> Result<()> {
        self.upload()
    }

    fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    fn normals(&mut self) -> Result<Option<(Array, Vec<u32>)>> {
        M::normals(self)
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let metres = self.worker.body().positions();
        Ok(self.to_file_units(&metres))
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        let unit = self.model.length_unit();
        let metres = self.worker.body().velocities();
        Ok(metres.iter().map(|v| *v / unit).collect())
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        M::set_positions(self, positions)
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        M::set_velocities(self, velocities)
    }

    fn loads(&self) -> &Loads {
        &self.loads
    }

    fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        // The latest published positions avoid waiting for a step in progress.
        let positions = self.to_file_units(&self.worker.positions());
        let model = &self.model;
        self.loads
            .grab(&positions, |i| model.has_node(i), (centre, radius), grip)
    }

    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange> {
        M::cut(self, blade)
    }

    fn report(&self) -> Result<Report> {
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        let energy = self.model.energy(&positions, &velocities);
        Ok(Report::from_positions(energy, &self.mesh, &positions))
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        M::set_inversion_allowed(self, allowed);
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        M::force_balance(self)
    }

    fn rms_speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.model.masses().iter().sum();
        let speed = (2.0 * self.progress.last.kinetic.max(0.0) / mass).sqrt();
        speed / (self.model.frame().scale * self.model.length_unit())
    }

    fn change_count(&self) -> u64 {
        self.changes + self.loads.version()
    }

    fn has_state(&self) -> bool {
        M::checkpoint(self).is_some()
    }

    fn state(&self) -> Result<SimulatorState> {
        let saved = M::checkpoint(self).ok_or_else(|| Capability::Checkpoints.unsupported())?;
        saved.state()
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let saved = M::checkpoint_mut(self).ok_or_else(|| Capability::Checkpoints.unsupported())?;
        saved.set_state(state)
    }

    fn pose(&self) -> Result<ExactPositions> {
        let saved = M::checkpoint(self).ok_or_else(|| Capability::Checkpoints.unsupported())?;
        saved.pose()
    }

    fn set_pose(&mut self, pose: &ExactPositions) -> Result<()> {
        let saved = M::checkpoint_mut(self).ok_or_else(|| Capability::Checkpoints.unsupported())?;
        saved.set_pose(pose)
    }
}
