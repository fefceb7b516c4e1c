//! The [`Simulator`] implementation of grid bodies stepped on the GPU.

use crate::gpu::{Array, Gpu, Recorder};
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::grid::retain_tets;
use crate::physics::{
    CgSettings, Checkpointing, Engine, ExactPositions, ForceBalance, GrabId, GrabMode, GridBody,
    Loads, NodePositions, Report, Simulator, SimulatorState, SolverKind, StepProgress, StepRecord,
    TopologyChange,
};
use crate::{Error, Result};
use glam::DVec3;

/// A [`GridBody`], and the mesh of its complete cells with its fields.
pub struct GpuGrid {
    gpu: Gpu,
    mesh: TetMesh,
    topology: Topology,
    body: GridBody,
}

impl GpuGrid {
    /// `body`, drawn as `mesh`, which may have additional fields and names.
    ///
    /// # Errors
    /// [`Error::Input`] if `mesh` is not the mesh of the body.
    pub fn new(gpu: &Gpu, body: GridBody, mesh: TetMesh) -> Result<GpuGrid> {
        body.model().check_mesh(&mesh)?;
        Ok(GpuGrid {
            gpu: gpu.clone(),
            topology: Topology::new(&mesh),
            mesh,
            body,
        })
    }

    fn progress_now(&self) -> StepProgress {
        let (steps, time) = self.body.clock();
        StepProgress {
            steps,
            time,
            last: StepRecord::default(),
        }
    }
}

impl Simulator for GpuGrid {
    fn integrator(&self) -> SolverKind {
        SolverKind::Verlet
    }

    fn engine(&self) -> Engine {
        Engine::Gpu
    }

    fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn masses(&self) -> &[f64] {
        &self.body.model().masses
    }

    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        self.body.model().spring_pairs()
    }

    fn set_integrator(&mut self, kind: SolverKind, _: CgSettings) -> Result<()> {
        match kind {
            SolverKind::Verlet => Ok(()),
            kind => Err(Error::Input(format!(
                "a grid body supports the solver verlet only, not {kind}"
            ))),
        }
    }

    fn largest_stable_step(&self) -> Option<f64> {
        Some(self.body.model().conservative_step())
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        self.body.advance(steps, dt)
    }

    fn progress(&mut self) -> Result<StepProgress> {
        self.body.poll(false)?;
        Ok(self.progress_now())
    }

    fn finish(&mut self) -> Result<StepProgress> {
        self.body.finish()?;
        Ok(self.progress_now())
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.body.record(work, steps, dt)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        Ok(Vec::new())
    }

    fn update_nodes(&mut self, _: &mut Recorder) -> Result<()> {
        Ok(())
    }

    fn nodes(&self) -> &NodePositions {
        self.body.nodes()
    }

    fn normals(&mut self) -> Result<Option<(Array, Vec<u32>)>> {
        let at_rest = self.body.rest_normals()?;
        Ok(Some((self.body.normals().clone(), at_rest)))
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        self.body.positions()
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        self.body.velocities()
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.body.set_positions(positions)
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        self.body.set_velocities(velocities)
    }

    fn loads(&self) -> &Loads {
        self.body.loads()
    }

    fn loads_mut(&mut self) -> &mut Loads {
        self.body.loads_mut()
    }

    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        self.body.grab(centre, radius, grip)
    }

    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange> {
        let cut = self.body.cut(blade)?;
        Ok(TopologyChange {
            mesh: retain_tets(&mut self.mesh, &mut self.topology, &self.body.mesh().tets),
            springs: cut.springs,
        })
    }

    fn report(&self) -> Result<Report> {
        self.body.report()
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        let model = self.body.model();
        let resolution = 0.5 * f64::from(f32::EPSILON) * model.frame.scale * model.length_unit;
        Ok(Some(model.force_balance(
            self.loads(),
            &self.positions()?,
            resolution,
        )))
    }

    fn rms_speed(&self) -> f64 {
        self.body.speed()
    }

    fn change_count(&self) -> u64 {
        self.body.change_count()
    }

    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        Some(self)
    }

    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        Some(self)
    }
}

impl Checkpointing for GpuGrid {
    fn state(&self) -> Result<SimulatorState> {
        Ok(SimulatorState::new(self.body.state()?))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        self.body.set_state(state.expect()?)
    }

    fn exact_positions(&self) -> Result<ExactPositions> {
        Ok(ExactPositions {
            positions: self.gpu.read_array(self.body.nodes().array())?,
            normals: self.gpu.read_array(self.body.normals())?,
            ..ExactPositions::default()
        })
    }

    fn set_exact_positions(&mut self, pose: &ExactPositions) -> Result<()> {
        self.body.place_particles(&pose.positions, &pose.normals)
    }
}
