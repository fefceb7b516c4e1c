//! Simulator of a grid body, stepped on the CPU.

use crate::gpu::{Array, Gpu, Texel};
use crate::mesh::{Blade, LocalFrame, NO_NORMAL, TetMesh, pack_normal};
use crate::physics::cpu::runtime::checkpoint::{ResumableModel, ThreadedState};
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::steppable::{GridParticles, Precision};
use crate::physics::cpu::runtime::threaded_simulator::{BodyModel, ThreadedSimulator};
use crate::physics::cpu::runtime::worker::Worker;
use crate::physics::grid::{GridModel, retain_tets};
use crate::physics::simulator::capability::Capability;
use crate::physics::simulator::checkpoint::Checkpointing;
use crate::physics::simulator::unsupported_term;
use crate::physics::{
    CgSettings, Energy, Engine, ForceBalance, Loads, NodeTerm, Simulator, SolverKind,
    TopologyChange,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A grid body on CPU threads.
pub type CpuGrid = ThreadedSimulator<CpuGridModel>;

/// The model of a [`CpuGrid`].
pub struct CpuGridModel {
    gpu: Gpu,
    grid: GridModel,
    precision: Precision,
    /// Packed normals of the particles, created on first request.
    normals: Option<Array>,
}

/// The state of a [`CpuGrid`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CpuGridState(ThreadedState);

impl From<ThreadedState> for CpuGridState {
    fn from(state: ThreadedState) -> CpuGridState {
        CpuGridState(state)
    }
}

impl AsRef<ThreadedState> for CpuGridState {
    fn as_ref(&self) -> &ThreadedState {
        &self.0
    }
}

impl CpuGrid {
    /// Creates the body of `model` at rest, stepped in the given precision; `mesh`, over the
    /// model's full cells, may carry fields and names. `gpu` renders it.
    ///
    /// # Errors
    /// [`Error::Input`] for another mesh, [`Error::Gpu`] if its nodes do not fit the device.
    pub fn new(
        gpu: &Gpu,
        model: GridModel,
        mesh: TetMesh,
        precision: Precision,
    ) -> Result<CpuGrid> {
        model.check_mesh(&mesh)?;
        let body = precision.grid(&model, None);
        let model = CpuGridModel {
            gpu: gpu.clone(),
            grid: model,
            precision,
            normals: None,
        };
        ThreadedSimulator::from_body(gpu, (mesh, model), body)
    }

    /// Sets particle positions (file units) and velocities (file units/s).
    fn set_particles(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        self.check_positions(positions)?;
        let metres = self.to_metres(positions);
        let velocities = self.to_metres_per_second(velocities);
        self.worker.body().set_state(&metres, &velocities)?;
        self.changes += 1;
        self.upload_now()
    }
}

fn packed(normals: &[DVec3]) -> Vec<u32> {
    let pack = |n: &DVec3| match *n == DVec3::ZERO {
        true => NO_NORMAL,
        false => pack_normal(*n),
    };
    normals.iter().map(pack).collect()
}

impl BodyModel for CpuGridModel {
    type Body = dyn GridParticles;

    const ENGINE: Engine = Engine::Cpu;

    fn integrator(&self) -> SolverKind {
        SolverKind::Verlet
    }

    fn solver_name(&self) -> &'static str {
        "verlet on the grid"
    }

    fn frame(&self) -> LocalFrame {
        self.grid.frame
    }

    fn length_unit(&self) -> f64 {
        self.grid.length_unit
    }

    fn masses(&self) -> &[f64] {
        &self.grid.masses
    }

    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        self.grid.spring_pairs()
    }

    fn has_node(&self, i: usize) -> bool {
        self.grid.masses[i] > 0.0
    }

    fn energy(&self, positions: &[DVec3], velocities: &[DVec3]) -> Energy {
        self.grid.energy(positions, velocities)
    }

    fn largest_stable_step(&self, _: &Loads) -> Option<f64> {
        Some(self.grid.conservative_step())
    }

    fn describe_failure(&self, _: &StepFailure) -> (FailureCause, String) {
        let failure = StepFailure::Diverged;
        (failure.cause(), failure.to_string())
    }

    fn failure_advice(&self, dt: f64, _: &Loads) -> String {
        let stable = self.grid.conservative_step();
        match dt > stable {
            true => format!("use --dt {stable:.3e} or less"),
            false => "reduce the forces, or move the particles less far".into(),
        }
    }

    fn check_prescribed_motion(&self, _: &[u32]) -> Result<()> {
        Err(Capability::PrescribedMotion.unsupported())
    }

    fn set_integrator(_: &mut CpuGrid, kind: SolverKind, _: CgSettings) -> Result<()> {
        match kind {
            SolverKind::Verlet => Ok(()),
            kind => Err(Error::Input(format!(
                "a grid body supports the solver verlet only, not {kind}"
            ))),
        }
    }

    fn add_term(_: &mut CpuGrid, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(unsupported_term(&*term))
    }

    fn set_positions(simulator: &mut CpuGrid, positions: &[DVec3]) -> Result<()> {
        simulator.set_particles(positions, &vec![DVec3::ZERO; positions.len()])
    }

    fn set_velocities(simulator: &mut CpuGrid, velocities: &[DVec3]) -> Result<()> {
        let positions = simulator.positions()?;
        simulator.set_particles(&positions, velocities)
    }

    fn cut(simulator: &mut CpuGrid, blade: &Blade) -> Result<TopologyChange> {
        simulator.finish()?;
        let positions = simulator.positions()?;
        let grid = &mut simulator.model.grid;
        let crossed = grid.springs_crossing(blade, &positions);
        if crossed.is_empty() {
            return Ok(TopologyChange::default());
        }
        let left = grid.erase(&crossed)?;
        simulator.worker.body().set_springs(&grid.springs)?;
        simulator.changes += 1;
        simulator.upload_now()?;
        let (mesh, topology) = (&mut simulator.mesh, &mut simulator.topology);
        Ok(TopologyChange {
            mesh: retain_tets(mesh, topology, &left.tets),
            springs: crossed.len(),
        })
    }

    fn force_balance(simulator: &CpuGrid) -> Result<Option<ForceBalance>> {
        let positions = simulator.positions()?;
        let resolution = 0.0;
        let grid = &simulator.model.grid;
        Ok(Some(grid.force_balance(
            &simulator.loads,
            &positions,
            resolution,
        )))
    }

    fn normals(simulator: &mut CpuGrid) -> Result<Option<(Array, Vec<u32>)>> {
        let model = &mut simulator.model;
        let mut rest = model.precision.grid(&model.grid, None);
        rest.set_springs(&model.grid.springs)?;
        let at_rest = packed(&rest.normals());
        let now = packed(&simulator.worker.body().normals());
        let array = match &model.normals {
            Some(array) => array.clone(),
            None => model
                .gpu
                .array("approximate normals", Texel::U32, now.len())?,
        };
        model.gpu.write_array(&array, &now)?;
        model.normals = Some(array.clone());
        Ok(Some((array, at_rest)))
    }

    fn upload_normals(&self, worker: &Worker<dyn GridParticles>) -> Result<()> {
        let Some(normals) = &self.normals else {
            return Ok(());
        };
        let packed = packed(&worker.body().normals());
        self.gpu.write_array(normals, &packed)
    }

    fn checkpoint(simulator: &CpuGrid) -> Option<&dyn Checkpointing> {
        Some(simulator)
    }

    fn checkpoint_mut(simulator: &mut CpuGrid) -> Option<&mut dyn Checkpointing> {
        Some(simulator)
    }
}

impl ResumableModel for CpuGridModel {
    type State = CpuGridState;

    fn rebuild(simulator: &CpuGrid, parts: usize) -> Result<Box<dyn GridParticles>> {
        let model = &simulator.model;
        Ok(model.precision.grid(&model.grid, Some(parts)))
    }

    fn exact_positions(body: &dyn GridParticles) -> Vec<[f64; 3]> {
        body.positions().iter().map(|x| x.to_array()).collect()
    }

    fn set_exact_positions(body: &mut dyn GridParticles, positions: &[[f64; 3]]) -> Result<()> {
        let metres: Vec<DVec3> = positions.iter().map(|x| DVec3::from(*x)).collect();
        body.set_state(&metres, &vec![DVec3::ZERO; metres.len()])
    }
}
