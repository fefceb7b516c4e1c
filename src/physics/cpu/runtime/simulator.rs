//! The [`Simulator`] implementation of bodies stepped on their own threads.

use super::steppable::Steppable;
use super::threaded_simulator::{BodyModel, ThreadedSimulator};
use super::worker::WorkerCommand;
use crate::Result;
use crate::gpu::{Array, Recorder};
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    CgSettings, Checkpointing, Contact, DiscreteModel, Engine, ForceBalance, GrabId, GrabMode,
    Gradients, Joints, Loads, NodePositions, NodeTerm, PrescribedMotionId, Reactions, Report,
    ScaledLoads, Simulator, SolverKind, StepCallback, StepProgress, TopologyChange,
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

    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        self.model.edge_nodes()
    }

    fn model(&self) -> Option<&DiscreteModel> {
        self.model.discrete_model()
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        M::set_integrator(self, kind, settings)
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        M::add_term(self, term)
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

    fn contact(&mut self) -> Option<&mut dyn Contact> {
        M::contact(self)
    }

    fn reactions(&mut self) -> Option<&mut dyn Reactions> {
        M::reactions(self)
    }

    fn scaled_loads(&mut self) -> Option<&mut dyn ScaledLoads> {
        M::scaled_loads(self)
    }

    fn gradients(&mut self) -> Option<&mut dyn Gradients> {
        M::gradients(self)
    }

    fn joints(&mut self) -> Option<&mut dyn Joints> {
        M::joints(self)
    }

    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        M::checkpoint(self)
    }

    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        M::checkpoint_mut(self)
    }
}
