//! Simulator of a fine mesh embedded in a coarse body.

use super::{Cage, CageReport, Embedding};
use crate::gpu::{Gpu, Recorder};
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::{
    CgSettings, Checkpointing, Engine, ForceBalance, GrabId, GrabMode, Loads, NodePositions,
    NodeTerm, Report, Simulator, SolverKind, StepProgress, TopologyChange,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// A mesh embedded in a [`Cage`]. Only the cage is simulated, so the mesh can be neither cut nor
/// moved node by node.
pub struct EmbeddedSimulator {
    cage: Cage,
    inner: Box<dyn Simulator>,
    mesh: TetMesh,
    topology: Topology,
    embedding: Embedding,
}

impl EmbeddedSimulator {
    /// Creates the simulator of `mesh` in `cage`, which `inner` simulates.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device cannot allocate the nodes of the mesh.
    pub fn new(
        gpu: &Gpu,
        mesh: TetMesh,
        cage: Cage,
        inner: Box<dyn Simulator>,
    ) -> Result<EmbeddedSimulator> {
        let transfer = cage.transfer().clone();
        let embedding = Embedding::with_transfer(gpu, transfer, inner.nodes(), &mesh)?;
        Ok(EmbeddedSimulator {
            cage,
            inner,
            topology: Topology::new(&mesh),
            mesh,
            embedding,
        })
    }

    /// Returns statistics of the cage.
    pub fn report(&self) -> CageReport {
        self.cage.report()
    }

    /// Returns the minimum grab radius, which ensures that a grab contains a node of the cage.
    fn reach(&self) -> f64 {
        0.51 * DVec3::from(self.cage.report().spacing).length()
    }
}

fn refused(what: &str) -> Error {
    Error::Input(format!(
        "a mesh in a cage does not support {what}; remove [cage]"
    ))
}

impl Simulator for EmbeddedSimulator {
    fn integrator(&self) -> SolverKind {
        self.inner.integrator()
    }

    fn engine(&self) -> Engine {
        self.inner.engine()
    }

    fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn masses(&self) -> &[f64] {
        self.inner.masses()
    }

    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        self.inner.edge_nodes()
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        self.inner.set_integrator(kind, settings)
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(refused(&format!("the term {}", term.name())))
    }

    fn largest_stable_step(&self) -> Option<f64> {
        self.inner.largest_stable_step()
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        self.inner.advance(steps, dt)
    }

    fn set_waker(&mut self, waker: crate::physics::StepCallback) {
        self.inner.set_waker(waker);
    }

    fn progress(&mut self) -> Result<StepProgress> {
        self.inner.progress()
    }

    fn finish(&mut self) -> Result<StepProgress> {
        self.inner.finish()
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.inner.record(work, steps, dt)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        self.inner.iterations()
    }

    fn update_nodes(&mut self, work: &mut Recorder) -> Result<()> {
        self.inner.update_nodes(work)?;
        self.embedding.record_update(work, self.inner.nodes());
        Ok(())
    }

    fn nodes(&self) -> &NodePositions {
        self.embedding.nodes()
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        self.embedding.interpolate(&self.inner.positions()?)
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        self.embedding.interpolate(&self.inner.velocities()?)
    }

    fn set_positions(&mut self, _: &[DVec3]) -> Result<()> {
        Err(refused(
            "setting node positions, because the cage determines them",
        ))
    }

    fn set_velocities(&mut self, _: &[DVec3]) -> Result<()> {
        Err(refused("setting node velocities"))
    }

    fn restart(&mut self) -> Result<()> {
        self.inner.restart()
    }

    fn loads(&self) -> &Loads {
        self.inner.loads()
    }

    fn loads_mut(&mut self) -> &mut Loads {
        self.inner.loads_mut()
    }

    fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        let count = self.mesh.nodes.len();
        if let Some(bad) = nodes.iter().find(|v| **v as usize >= count) {
            return Err(Error::Input(format!(
                "cannot pin node {bad}: there are {count} nodes, counted from 0"
            )));
        }
        self.inner.pin_nodes(&self.cage.coarse_nodes_for(nodes))
    }

    fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.inner
            .set_forces(&self.cage.transfer().apply_transpose(forces)?)
    }

    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        self.inner.grab(centre, radius.max(self.reach()), grip)
    }

    fn cut(&mut self, _: &Blade) -> Result<TopologyChange> {
        Err(refused("cuts"))
    }

    fn coarse_body(&self) -> Option<&dyn Simulator> {
        Some(self.inner.as_ref())
    }

    fn report(&self) -> Result<Report> {
        let energy = self.inner.report()?.energy;
        Ok(Report::from_positions(
            energy,
            &self.mesh,
            &self.positions()?,
        ))
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        self.inner.set_inversion_allowed(allowed);
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        self.inner.force_balance()
    }

    fn rms_speed(&self) -> f64 {
        self.inner.rms_speed()
    }

    fn change_count(&self) -> u64 {
        self.inner.change_count()
    }

    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        self.inner.checkpoint()
    }

    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        self.inner.checkpoint_mut()
    }
}
