//! Simulator of a grid body, stepped on the CPU.

use crate::gpu::{Array, Gpu, Recorder, Texel};
use crate::mesh::{Blade, NO_NORMAL, TetMesh, Topology, pack_normal};
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::load_sync::{full_load_update, send_loads};
use crate::physics::cpu::runtime::steppable::{GridParticles, Precision};
use crate::physics::cpu::runtime::worker::{StepClock, Worker, WorkerCommand, WorkerError};
use crate::physics::grid::{GridModel, retain_tets};
use crate::physics::loads::{LoadVersions, LoadsState};
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    CgSettings, Engine, ExactPositions, ForceBalance, GrabId, GrabMode, Loads, NodePositions,
    Report, Simulator, SimulatorState, SolverKind, StepCallback, StepProgress, TopologyChange,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A grid body on CPU threads.
pub struct CpuGrid {
    gpu: Gpu,
    mesh: TetMesh,
    topology: Topology,
    model: GridModel,
    loads: Loads,
    /// Versions of the loads that the worker has.
    synced_loads: Option<LoadVersions>,
    precision: Precision,
    worker: Worker<dyn GridParticles>,
    nodes: NodePositions,
    /// Version of the uploaded positions.
    uploaded_version: u64,
    /// Packed normals of the particles, created on first request.
    normals: Option<Array>,
    /// Counter of external changes of state and shape.
    changes: u64,
    progress: StepProgress,
}

/// The state of a [`CpuGrid`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CpuGridState {
    /// State of the particles, serialised in their own precision.
    particles: Vec<u8>,
    loads: LoadsState,
    sent: Option<LoadVersions>,
    changes: u64,
    progress: StepProgress,
    span: StepClock,
    /// Number of slabs among which the particles are partitioned.
    parts: usize,
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
        let nodes = NodePositions::new(gpu, &mesh)?;
        Ok(CpuGrid {
            gpu: gpu.clone(),
            topology: Topology::new(&mesh),
            loads: Loads::new(mesh.nodes.len(), model.frame, model.length_unit),
            precision,
            worker: Worker::new(precision.grid(&model, None)),
            mesh,
            model,
            synced_loads: None,
            nodes,
            uploaded_version: 0,
            normals: None,
            changes: 0,
            progress: StepProgress::default(),
        })
    }

    fn error(&mut self, refusal: WorkerError) -> Error {
        match refusal {
            WorkerError::Wrong(error) => {
                // Rejected loads are sent again.
                self.synced_loads = None;
                error
            }
            WorkerError::Failed(StepFailure::BadStep { h }, ..) => {
                Error::Input(format!("time step must be finite and > 0, got {h} s"))
            }
            WorkerError::Failed(_, dt, progress) => {
                self.progress = progress;
                let stable = self.model.conservative_step();
                Error::Solver {
                    solver: "verlet on the grid",
                    step: progress.steps + 1,
                    time: progress.time,
                    cause: FailureCause::FlownApart,
                    what: "particles diverged".into(),
                    advice: match dt > stable {
                        true => format!("use --dt {stable:.3e} or less"),
                        false => "reduce the forces, or move the particles less far".into(),
                    },
                }
            }
        }
    }

    /// Converts positions in metres to file units; missing particles keep their positions in the
    /// mesh.
    fn places(&self, metres: &[DVec3]) -> Vec<DVec3> {
        let (origin, unit) = (self.model.frame.origin, self.model.length_unit);
        let nodes = metres.iter().zip(&self.mesh.nodes).zip(&self.model.masses);
        nodes
            .map(|((x, rest), mass)| match *mass > 0.0 {
                true => origin + *x / unit,
                false => *rest,
            })
            .collect()
    }

    fn to_metres(&self, p: DVec3) -> DVec3 {
        (p - self.model.frame.origin) * self.model.length_unit
    }

    /// Uploads the latest published positions, if they are new.
    fn upload_published(&mut self) -> Result<()> {
        let Some((version, positions)) = self.worker.published(self.uploaded_version) else {
            return Ok(());
        };
        self.uploaded_version = version;
        let places = self.places(&positions);
        self.nodes.set_positions(&places)?;
        match &self.normals {
            Some(normals) => {
                let packed = packed(&self.worker.body().normals());
                self.gpu.write_array(normals, &packed)
            }
            None => Ok(()),
        }
    }

    /// Rebuilds the particles with `parts` slabs if they have another number; their state must be
    /// set afterwards.
    fn repartition(&mut self, parts: usize) -> Result<()> {
        let mut body = self.worker.body();
        if body.parts() != parts {
            *body = self.precision.grid(&self.model, Some(parts));
        }
        Ok(())
    }

    /// Uploads the current positions.
    fn upload_now(&mut self) -> Result<()> {
        self.worker.publish();
        self.upload_published()
    }

    /// Sets particle positions and velocities, in file units.
    fn set_particles(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let frame = self.nodes.frame();
        self.nodes
            .check("positions", positions, |p| frame.to_local(p))?;
        let metres: Vec<DVec3> = positions.iter().map(|p| self.to_metres(*p)).collect();
        let unit = self.model.length_unit;
        let speeds: Vec<DVec3> = velocities.iter().map(|v| *v * unit).collect();
        self.worker.body().set_state(&metres, &speeds)?;
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

impl Simulator for CpuGrid {
    fn integrator(&self) -> SolverKind {
        SolverKind::Verlet
    }

    fn engine(&self) -> Engine {
        Engine::Cpu
    }

    fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn masses(&self) -> &[f64] {
        &self.model.masses
    }

    fn spring_pairs(&self) -> Vec<[u32; 2]> {
        self.model.spring_pairs()
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
        Some(self.model.conservative_step())
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        check_time_step(dt)?;
        send_loads(&self.loads, &mut self.synced_loads, &mut self.worker)?;
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
        self.upload_published()
    }

    fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    fn normals(&mut self) -> Result<Option<(Array, Vec<u32>)>> {
        let mut rest = self.precision.grid(&self.model, None);
        rest.set_springs(&self.model.springs)?;
        let at_rest = packed(&rest.normals());
        let now = packed(&self.worker.body().normals());
        let array = match &self.normals {
            Some(array) => array.clone(),
            None => self
                .gpu
                .array("approximate normals", Texel::U32, now.len())?,
        };
        self.gpu.write_array(&array, &now)?;
        self.normals = Some(array.clone());
        Ok(Some((array, at_rest)))
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let metres = self.worker.body().positions();
        Ok(self.places(&metres))
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        let unit = self.model.length_unit;
        let metres = self.worker.body().velocities();
        Ok(metres.iter().map(|v| *v / unit).collect())
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.set_particles(positions, &vec![DVec3::ZERO; positions.len()])
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let positions = self.positions()?;
        self.set_particles(&positions, velocities)
    }

    fn loads(&self) -> &Loads {
        &self.loads
    }

    fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        let positions = self.positions()?;
        let masses = &self.model.masses;
        let there = |i: usize| masses[i] > 0.0;
        self.loads.grab(&positions, there, (centre, radius), grip)
    }

    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange> {
        self.finish()?;
        let crossed = self.model.springs_crossing(blade, &self.positions()?);
        if crossed.is_empty() {
            return Ok(TopologyChange::default());
        }
        let left = self.model.erase(&crossed)?;
        self.worker.body().set_springs(&self.model.springs)?;
        self.changes += 1;
        self.upload_now()?;
        Ok(TopologyChange {
            mesh: retain_tets(&mut self.mesh, &mut self.topology, &left.tets),
            springs: crossed.len(),
        })
    }

    fn report(&self) -> Result<Report> {
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        let energy = self.model.energy(&positions, &velocities);
        Ok(Report::from_positions(energy, &self.mesh, &positions))
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        let model = &self.model;
        let resolution = 0.0;
        Ok(Some(model.force_balance(
            &self.loads,
            &self.positions()?,
            resolution,
        )))
    }

    fn rms_speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.model.masses.iter().sum();
        let speed = (2.0 * self.progress.last.kinetic / mass).sqrt();
        speed / (self.model.frame.scale * self.model.length_unit)
    }

    fn change_count(&self) -> u64 {
        self.changes + self.loads.version()
    }

    fn state(&self) -> Result<SimulatorState> {
        let (particles, parts) = {
            let body = self.worker.body();
            (body.serialise_state()?, body.parts())
        };
        Ok(SimulatorState::new(CpuGridState {
            particles,
            loads: self.loads.state(),
            sent: self.synced_loads,
            changes: self.changes,
            progress: self.progress,
            span: self.worker.span(),
            parts,
        }))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let state: &CpuGridState = state.expect()?;
        self.worker.cancel_pending();
        self.loads.set_state(&state.loads)?;
        self.repartition(state.parts)?;
        {
            let mut body = self.worker.body();
            body.apply_loads(full_load_update(&self.loads))?;
            body.resume(&state.particles)?;
        }
        self.synced_loads = state.sent;
        self.changes = state.changes;
        self.progress = state.progress;
        self.worker.set_progress(state.progress, state.span);
        self.upload_now()
    }

    fn pose(&self) -> Result<ExactPositions> {
        let positions = self.worker.body().positions();
        Ok(ExactPositions {
            displacements: positions.iter().map(|x| x.to_array()).collect(),
            ..ExactPositions::default()
        })
    }

    fn set_pose(&mut self, pose: &ExactPositions) -> Result<()> {
        let metres: Vec<DVec3> = pose.displacements.iter().map(|x| DVec3::from(*x)).collect();
        let still = vec![DVec3::ZERO; metres.len()];
        self.worker.body().set_state(&metres, &still)?;
        self.upload_now()
    }
}
