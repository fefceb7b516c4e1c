//! Tetrahedral bodies stepped on the CPU: what they are made of.

use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::cpu::runtime::checkpoint::ThreadedState;
use crate::physics::cpu::runtime::steppable::{LoadUpdate, Precision, TetBody};
use crate::physics::cpu::runtime::threaded_simulator::ThreadedSimulator;
use crate::physics::{
    CgSettings, DiscreteModel, Material, NodeTerm, ScaledLoad, SelfContactSettings, SolverKind,
    Tool,
};
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A tetrahedral body on CPU threads. Steps run on a worker thread that distributes them in rayon's
/// global pool: do not wait for them from within that pool. Positions for rendering are uploaded
/// once per frame.
pub type CpuTets = ThreadedSimulator<CpuTetModel>;

/// The model of a [`CpuTets`].
pub struct CpuTetModel {
    pub(in crate::physics) material: Material,
    pub(in crate::physics) network: DiscreteModel,
    pub(super) settings: CgSettings,
    pub(in crate::physics) kind: SolverKind,
    pub(in crate::physics) terms: Vec<Arc<dyn NodeTerm>>,
    /// Pressures and muscles, in the order of their amplitudes.
    pub(in crate::physics) scaled_loads: Vec<ScaledLoad>,
    pub(in crate::physics) tools: Vec<Tool>,
    pub(in crate::physics) self_contact: Option<SelfContactSettings>,
    pub(super) inversion_allowed: bool,
    pub(in crate::physics) precision: Precision,
}

/// The state of a [`CpuTets`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CpuState(ThreadedState);

impl From<ThreadedState> for CpuState {
    fn from(state: ThreadedState) -> CpuState {
        CpuState(state)
    }
}

impl AsRef<ThreadedState> for CpuState {
    fn as_ref(&self) -> &ThreadedState {
        &self.0
    }
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
        CpuTets::of_model(gpu, (mesh, network), material, (kind, settings), precision)
    }

    /// As [`CpuTets::new`], with a custom model, such as that of a cage.
    ///
    /// # Errors
    /// [`Error::Input`] if `network` does not match `mesh`; otherwise as [`CpuTets::new`].
    pub fn of_model(
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
        let model = CpuTetModel {
            material: material.clone(),
            network,
            settings,
            kind,
            terms: Vec::new(),
            scaled_loads: Vec::new(),
            tools: Vec::new(),
            self_contact: None,
            inversion_allowed: false,
            precision,
        };
        ThreadedSimulator::from_body(gpu, (mesh, model), body)
    }

    /// Creates a body of the current network at rest, partitioned into `parts` chunks, or a
    /// suitable number.
    pub(super) fn body(&self, parts: Option<usize>) -> Result<Box<dyn TetBody>> {
        let how = (self.model.kind, self.model.settings);
        let mut body = self.model.precision.tets(&self.model.network, how, parts)?;
        body.set_inversion_allowed(self.model.inversion_allowed);
        for term in &self.model.terms {
            body.add_node_term(term.clone(), &self.model.network);
        }
        for (level, acting) in self.model.scaled_loads.iter().enumerate() {
            self.apply_scaled_load(&mut *body, acting, level);
        }
        let faces = self.boundary();
        for (tool, (pose, _)) in self.model.tools.iter().zip(self.loads.tools()) {
            let there = Tool {
                pose: *pose,
                ..tool.clone()
            };
            body.add_tool(&there, &faces, &self.model.network);
        }
        if let Some(wanted) = &self.model.self_contact {
            body.set_self_contact(wanted, &faces, &self.model.network);
        }
        body.apply_loads(LoadUpdate {
            gravity: self.loads.gravity(),
            levels: Some(self.loads.amplitudes().to_vec()),
            pinned: Some(self.loads.pinned().to_vec()),
            ..LoadUpdate::default()
        })?;
        Ok(body)
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
                let middles = match self.model.network.elements() {
                    Some(elements) if elements.order() == 2 => mesh.mid_edge_nodes(),
                    _ => Vec::new(),
                };
                let is_middle = |v: u32| middles.get(v as usize).copied().unwrap_or(false);
                let faces = faces.iter().map(|f| {
                    let nodes = topology.boundary_nodes(mesh, *f);
                    (nodes, nodes.map(is_middle))
                });
                body.add_pressure(&faces.collect::<Vec<_>>(), level);
            }
            ScaledLoad::Muscle(muscle) => {
                body.add_muscle(muscle, level, (&self.model.network, &self.mesh.tets));
            }
        }
    }

    /// Rebuilds the body from the current network, in the given state.
    pub(in crate::physics) fn rebuild_body(
        &mut self,
        positions: &[DVec3],
        velocities: &[DVec3],
    ) -> Result<()> {
        let mut body = self.body(None)?;
        body.set_state(
            &self.to_metres(positions),
            &self.to_metres_per_second(velocities),
        )?;
        *self.worker.body() = body;
        self.synced_loads = None;
        self.changes += 1;
        self.upload_now()
    }
}
