//! The [`Simulator`] implementation of tetrahedral bodies stepped on the GPU.

use crate::Result;
use crate::gpu::{Gpu, Recorder};
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::cpu::check_contact;
use crate::physics::loads::force_balance::balance_of_model;
use crate::physics::{
    BodyState, CgSettings, Checkpointing, Contact, DiscreteModel, Engine, ExactPositions,
    ForceBalance, GpuBody, GrabId, GrabMode, ImplicitEuler, Loads, Material, NodePositions,
    NodeTerm, Reaction, Report, Simulator, SimulatorState, Solver, SolverKind, SolverState,
    StepProgress, Tool, ToolId, TopologyChange, largest_stable_step, limit_with_terms,
};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A [`GpuBody`] with its mesh and its [`Solver`].
pub struct GpuTets {
    gpu: Gpu,
    mesh: TetMesh,
    topology: Topology,
    body: GpuBody,
    solver: Box<dyn Solver>,
    tools: Vec<Tool>,
    /// Length of the last requested steps, s.
    dt: f64,
    progress: StepProgress,
}

/// The state of a [`GpuTets`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct TetState {
    body: BodyState,
    solver: SolverState,
    progress: StepProgress,
}

impl GpuTets {
    /// A simulator of `mesh` made of `material`, at rest, with the solver `kind`.
    ///
    /// # Errors
    /// As [`GpuBody::new`].
    pub fn new(gpu: &Gpu, mesh: TetMesh, material: &Material, kind: SolverKind) -> Result<GpuTets> {
        let body = GpuBody::new(gpu, &mesh, material)?;
        let solver = kind.solver(gpu, &body)?;
        GpuTets::of_body(mesh, body, solver)
    }

    /// A simulator of `body`, built from `mesh`, and its solver.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `mesh` has a different number of nodes.
    pub fn of_body(mesh: TetMesh, body: GpuBody, solver: Box<dyn Solver>) -> Result<GpuTets> {
        body.check_mesh(&mesh)?;
        Ok(GpuTets {
            gpu: body.gpu.clone(),
            topology: Topology::new(&mesh),
            mesh,
            body,
            solver,
            tools: Vec::new(),
            dt: 0.0,
            progress: StepProgress::default(),
        })
    }

    /// The body.
    pub fn body(&self) -> &GpuBody {
        &self.body
    }
}

impl Simulator for GpuTets {
    fn integrator(&self) -> SolverKind {
        self.solver.kind()
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
        &self.body.model.masses
    }

    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        self.body.model.edge_nodes().collect()
    }

    fn model(&self) -> Option<&DiscreteModel> {
        Some(&self.body.model)
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        if !self.tools.is_empty() {
            check_contact("tools", self.body.model(), kind)?;
        }
        // Requested steps and results of the old solver are dropped with it.
        self.solver = match kind {
            SolverKind::Implicit => Box::new(ImplicitEuler::with(&self.gpu, &self.body, settings)?),
            kind => kind.solver(&self.gpu, &self.body)?,
        };
        self.progress = StepProgress::default();
        Ok(())
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        self.body.add_term(term)
    }

    fn largest_stable_step(&self) -> Option<f64> {
        let (model, terms) = (&self.body.model, self.body.terms());
        let limit = largest_stable_step(model, self.body.pinned(), self.integrator())?;
        Some(limit_with_terms(limit, model, terms))
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        self.dt = dt;
        self.solver.advance(&mut self.body, steps, dt)
    }

    fn progress(&mut self) -> Result<StepProgress> {
        if let Some(progress) = self.solver.progress(&mut self.body)? {
            self.progress = progress;
        }
        Ok(self.progress)
    }

    fn finish(&mut self) -> Result<StepProgress> {
        self.progress = self.solver.finish(&mut self.body)?;
        Ok(self.progress)
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.dt = dt;
        self.solver.record(work, &mut self.body, steps, dt)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        if !self.integrator().is_implicit() {
            return Ok(Vec::new());
        }
        let steps = self.solver.history(&self.body)?;
        Ok(steps.iter().map(|s| s.iterations).collect())
    }

    fn update_nodes(&mut self, _: &mut Recorder) -> Result<()> {
        Ok(())
    }

    fn nodes(&self) -> &NodePositions {
        self.body.nodes()
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
        let mesh = self.body.cut(&mut self.mesh, &mut self.topology, blade)?;
        if !(mesh.is_empty() || self.tools.is_empty()) {
            let faces = self.topology.boundary_triangles(&self.mesh);
            self.body.set_tools(&self.tools, &faces)?;
        }
        Ok(TopologyChange { mesh, springs: 0 })
    }

    fn report(&self) -> Result<Report> {
        Report::new(&self.body, &self.mesh)
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        self.body.set_inversion_allowed(allowed);
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        if !self.tools.is_empty() {
            return Ok(None);
        }
        let body = &self.body;
        // Positions in the local frame reach ½.
        let resolution = 0.5 * f64::from(f32::EPSILON) * body.units.length;
        Ok(balance_of_model(
            &body.model,
            body.loads(),
            body.terms(),
            &body.positions()?,
            resolution,
        ))
    }

    fn rms_speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.body.model.masses.iter().sum();
        let speed = (2.0 * self.progress.last.kinetic.max(0.0) / mass).sqrt();
        speed / self.body.units.length
    }

    fn change_count(&self) -> u64 {
        self.body.change_count()
    }

    fn contact(&mut self) -> Option<&mut dyn Contact> {
        Some(self)
    }

    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        Some(self)
    }

    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        Some(self)
    }
}

impl Contact for GpuTets {
    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        tool.check()?;
        check_contact("tools", self.body.model(), self.integrator())?;
        self.body.check_tools()?;
        let id = self.body.loads_mut().add_tool(tool.pose);
        self.tools.push(tool);
        let faces = self.topology.boundary_triangles(&self.mesh);
        self.body.set_tools(&self.tools, &faces)?;
        Ok(id)
    }

    fn tools(&self) -> &[Tool] {
        &self.tools
    }

    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        self.finish()?;
        self.body.tool_forces(self.dt)
    }
}

impl Checkpointing for GpuTets {
    fn state(&self) -> Result<SimulatorState> {
        Ok(SimulatorState::new(TetState {
            body: self.body.state()?,
            solver: self.solver.state()?,
            progress: self.progress,
        }))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let state: &TetState = state.expect()?;
        self.body.set_state(&state.body)?;
        self.solver.set_state(&self.body, &state.solver)?;
        self.progress = state.progress;
        Ok(())
    }

    fn exact_positions(&self) -> Result<ExactPositions> {
        Ok(ExactPositions {
            positions: self.body.nodes.local()?,
            ..ExactPositions::default()
        })
    }

    fn set_exact_positions(&mut self, pose: &ExactPositions) -> Result<()> {
        self.body.set_exact_positions(&pose.positions)
    }
}
