//! A tetrahedral body stepped on the CPU, with its mesh, its model and its loads.

use crate::gpu::Gpu;
use crate::mesh::{BoundaryFace, TetMesh, Topology};
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::steppable::{LoadUpdate, Precision, TetBody};
use crate::physics::cpu::runtime::worker::{StepClock, Worker, WorkerError};
use crate::physics::loads::{LoadVersions, LoadsState};
use crate::physics::{
    CgSettings, DiscreteModel, Loads, Material, NodePositions, NodeTerm, ScaledLoad,
    SelfContactSettings, SolverKind, StepProgress, Tool, time_step_advice,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A tetrahedral body on CPU threads. Steps run on a worker thread that distributes them in rayon's
/// global pool: do not wait for them from within that pool. Positions for rendering are uploaded
/// once per frame.
pub struct CpuTets {
    pub(super) mesh: TetMesh,
    pub(super) topology: Topology,
    pub(super) material: Material,
    pub(super) network: DiscreteModel,
    pub(super) settings: CgSettings,
    pub(super) kind: SolverKind,
    pub(super) loads: Loads,
    /// Versions of the loads that the worker has.
    pub(super) synced_loads: Option<LoadVersions>,
    pub(super) terms: Vec<Arc<dyn NodeTerm>>,
    /// Pressures and muscles, in the order of their amplitudes.
    pub(super) scaled_loads: Vec<ScaledLoad>,
    pub(super) tools: Vec<Tool>,
    pub(super) self_contact: Option<SelfContactSettings>,
    pub(super) inversion_allowed: bool,
    pub(super) precision: Precision,
    pub(super) worker: Worker<dyn TetBody>,
    pub(super) nodes: NodePositions,
    /// Version of the uploaded positions.
    pub(super) uploaded_version: u64,
    /// Counter of external changes of state and shape.
    pub(super) changes: u64,
    pub(super) progress: StepProgress,
}

/// The state of a [`CpuTets`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CpuState {
    /// State of the body, serialised in the body's own precision.
    pub(super) body: Vec<u8>,
    pub(super) loads: LoadsState,
    pub(super) sent: Option<LoadVersions>,
    pub(super) changes: u64,
    pub(super) progress: StepProgress,
    pub(super) span: StepClock,
    /// Number of chunks among which the nodes are partitioned: the rounding of sums depends on it.
    pub(super) parts: usize,
}

impl CpuTets {
    /// Creates a body of `mesh` and `material` at rest, stepped by `kind` in the given precision,
    /// with linear solves that stop as `settings` specify. `gpu` renders it.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid material, [`Error::Gpu`] if the nodes do not fit the device.
    pub fn new(
        gpu: &Gpu,
        mesh: TetMesh,
        material: &Material,
        kind: SolverKind,
        settings: CgSettings,
        precision: Precision,
    ) -> Result<CpuTets> {
        let network = DiscreteModel::new(&mesh, material)?;
        CpuTets::of_network(gpu, (mesh, network), material, (kind, settings), precision)
    }

    /// As [`CpuTets::new`], with a custom model of masses and springs, such as that of a cage.
    ///
    /// # Errors
    /// [`Error::Input`] if `network` does not match `mesh`; otherwise as [`CpuTets::new`].
    pub fn of_network(
        gpu: &Gpu,
        (mesh, network): (TetMesh, DiscreteModel),
        material: &Material,
        (kind, settings): (SolverKind, CgSettings),
        precision: Precision,
    ) -> Result<CpuTets> {
        if network.rest_positions.len() != mesh.nodes.len() {
            return Err(Error::Input(format!(
                "the model has {} nodes, but the mesh has {}",
                network.rest_positions.len(),
                mesh.nodes.len()
            )));
        }
        let body = precision.tets(&network, (kind, settings), None)?;
        let nodes = NodePositions::new(gpu, &mesh)?;
        Ok(CpuTets {
            topology: Topology::new(&mesh),
            material: material.clone(),
            loads: Loads::new(mesh.nodes.len(), nodes.frame(), network.length_unit),
            mesh,
            network,
            settings,
            kind,
            synced_loads: None,
            terms: Vec::new(),
            scaled_loads: Vec::new(),
            tools: Vec::new(),
            self_contact: None,
            inversion_allowed: false,
            precision,
            worker: Worker::new(body),
            nodes,
            uploaded_version: 0,
            changes: 0,
            progress: StepProgress::default(),
        })
    }

    /// Returns the error for a rejected step.
    pub(super) fn error(&mut self, refusal: WorkerError) -> Error {
        match refusal {
            WorkerError::Wrong(error) => {
                // Rejected loads are sent again.
                self.synced_loads = None;
                error
            }
            WorkerError::Failed(StepFailure::BadStep { h }, ..) => {
                Error::Input(format!("time step must be finite and > 0, got {h} s"))
            }
            WorkerError::Failed(failure, dt, progress) => {
                self.progress = progress;
                Error::Solver {
                    solver: self.kind.name(),
                    step: progress.steps + 1,
                    time: progress.time,
                    cause: match failure {
                        StepFailure::RunawayEnergy { .. } => FailureCause::RunawayEnergy,
                        StepFailure::InvertedTets => FailureCause::InvertedTets,
                        StepFailure::NotConverged { .. }
                        | StepFailure::ToolPenetration
                        | StepFailure::SelfContactBlocked => FailureCause::NotConverged,
                        _ => FailureCause::NotFinite,
                    },
                    what: failure.to_string(),
                    advice: time_step_advice(
                        self.kind,
                        dt,
                        (&self.network, &self.terms),
                        self.loads.pinned(),
                    ),
                }
            }
        }
    }

    pub(super) fn metres(&self, positions: &[DVec3]) -> Vec<DVec3> {
        positions
            .iter()
            .map(|p| self.network.to_metres(*p))
            .collect()
    }

    pub(super) fn to_file_units(&self, metres: &[DVec3]) -> Vec<DVec3> {
        metres.iter().map(|x| self.network.to_file(*x)).collect()
    }

    pub(super) fn velocities_in_metres(&self, velocities: &[DVec3]) -> Vec<DVec3> {
        let unit = self.network.length_unit;
        velocities.iter().map(|v| *v * unit).collect()
    }

    /// Uploads the latest published positions, if they are new.
    pub(super) fn upload(&mut self) -> Result<()> {
        let Some((version, positions)) = self.worker.published(self.uploaded_version) else {
            return Ok(());
        };
        self.uploaded_version = version;
        let unit = self.network.length_unit;
        let origin = self.network.frame.origin;
        let places: Vec<DVec3> = positions.iter().map(|x| origin + *x / unit).collect();
        self.nodes.set_positions(&places)
    }

    /// Uploads the current positions.
    pub(super) fn upload_now(&mut self) -> Result<()> {
        self.worker.publish();
        self.upload()
    }

    /// Creates a body of the current network at rest, partitioned into `parts` chunks, or a
    /// suitable number.
    pub(super) fn body(&self, parts: Option<usize>) -> Result<Box<dyn TetBody>> {
        let how = (self.kind, self.settings);
        let mut body = self.precision.tets(&self.network, how, parts)?;
        body.set_inversion_allowed(self.inversion_allowed);
        for term in &self.terms {
            body.add_node_term(term.clone(), &self.network);
        }
        for (level, acting) in self.scaled_loads.iter().enumerate() {
            self.apply_scaled_load(&mut *body, acting, level);
        }
        let faces = self.boundary();
        for (tool, (pose, _)) in self.tools.iter().zip(self.loads.tools()) {
            let there = Tool {
                pose: *pose,
                ..tool.clone()
            };
            body.add_tool(&there, &faces, &self.network);
        }
        if let Some(wanted) = &self.self_contact {
            body.set_self_contact(wanted, &faces, &self.network);
        }
        body.apply_loads(LoadUpdate {
            gravity: self.loads.gravity(),
            levels: Some(self.loads.amplitudes().to_vec()),
            pinned: Some(self.loads.pinned().to_vec()),
            ..LoadUpdate::default()
        })?;
        Ok(body)
    }

    /// Returns the boundary faces, by their nodes.
    pub(super) fn boundary(&self) -> Vec<[u32; 3]> {
        let faces = self.topology.boundary.iter();
        let nodes = |f: &BoundaryFace| self.topology.boundary_nodes(&self.mesh, *f);
        faces.map(nodes).collect()
    }

    /// Applies `acting` to `body`, made of this mesh and network.
    pub(super) fn apply_scaled_load(
        &self,
        body: &mut dyn TetBody,
        acting: &ScaledLoad,
        level: usize,
    ) {
        match acting {
            ScaledLoad::Pressure(faces) => {
                let (mesh, topology) = (&self.mesh, &self.topology);
                let faces = faces.iter().map(|f| topology.boundary_nodes(mesh, *f));
                body.add_pressure(&faces.collect::<Vec<_>>(), level);
            }
            ScaledLoad::Muscle(muscle) => {
                body.add_muscle(muscle, level, (&self.network, &self.mesh.tets));
            }
        }
    }

    /// Rebuilds the body from the current network, in the given state.
    pub(super) fn rebuild_body(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let mut body = self.body(None)?;
        body.set_state(
            &self.metres(positions),
            &self.velocities_in_metres(velocities),
        )?;
        *self.worker.body() = body;
        self.synced_loads = None;
        self.changes += 1;
        self.upload_now()
    }

    /// Rebuilds the body with `parts` chunks if it has another number; its state must be set
    /// afterwards.
    pub(super) fn repartition(&mut self, parts: usize) -> Result<()> {
        if self.worker.body().parts() != parts {
            let body = self.body(Some(parts))?;
            *self.worker.body() = body;
        }
        Ok(())
    }
}
