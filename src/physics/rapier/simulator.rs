//! Tetrahedral bodies stepped by rapier: their model, and the capabilities of such bodies.

use super::body::RapierBody;
use super::soft_body_model::SoftBodyModel;
use crate::gpu::Gpu;
use crate::mesh::{Blade, LocalFrame, TetMesh, Topology};
use crate::physics::cpu::{BodyModel, Steppable, ThreadedSimulator, count_intersecting_faces};
use crate::physics::simulator::contact::Contact;
use crate::physics::simulator::joints::Joints;
use crate::physics::simulator::reactions::Reactions;
use crate::physics::{
    CgSettings, DiscreteModel, Energy, Engine, ForceBalance, Joint, Loads, NodeTerm, Reaction,
    SelfContactSettings, Simulator, SolverKind, StepProgress, Tool, ToolId, ToolPose,
    TopologyChange,
};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeSet;
use std::sync::Arc;

/// A tetrahedral body that rapier steps on its own thread.
pub type RapierTets = ThreadedSimulator<RapierModel>;

/// The model of a [`RapierTets`].
pub struct RapierModel {
    model: DiscreteModel,
    tools: Vec<Tool>,
    self_contact: Option<SelfContactSettings>,
}

impl RapierTets {
    /// A body of `mesh` with the masses and elements of `model`, at rest; `settings` gives the
    /// tolerance of the linear solves. `gpu` draws it.
    ///
    /// # Errors
    /// [`Error::Input`] if rapier does not support the model, or the scheme is not implicit;
    /// [`Error::Gpu`] if the nodes do not fit the device.
    pub fn new(
        gpu: &Gpu,
        (mesh, model): (TetMesh, DiscreteModel),
        (kind, settings): (SolverKind, CgSettings),
    ) -> Result<RapierTets> {
        check_kind(kind)?;
        if model.rest_positions.len() != mesh.nodes.len() {
            return Err(Error::Input(format!(
                "the model has {} nodes, but the mesh has {}",
                model.rest_positions.len(),
                mesh.nodes.len()
            )));
        }
        let faces = Topology::new(&mesh).boundary_triangles(&mesh);
        let (matter, unit) = (SoftBodyModel::new(&model, &faces)?, model.length_unit);
        let body = RapierBody::new(matter, model.masses.clone(), settings, unit)?;
        let model = RapierModel {
            model,
            tools: Vec::new(),
            self_contact: None,
        };
        ThreadedSimulator::from_body(gpu, (mesh, model), Box::new(body))
    }
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

impl BodyModel for RapierModel {
    type Body = RapierBody;

    const ENGINE: Engine = Engine::Rapier;

    fn integrator(&self) -> SolverKind {
        SolverKind::Implicit
    }

    fn solver_name(&self) -> &'static str {
        "rapier"
    }

    fn frame(&self) -> LocalFrame {
        self.model.frame
    }

    fn length_unit(&self) -> f64 {
        self.model.length_unit
    }

    fn masses(&self) -> &[f64] {
        &self.model.masses
    }

    fn discrete_model(&self) -> Option<&DiscreteModel> {
        Some(&self.model)
    }

    fn energy(&self, positions: &[DVec3], velocities: &[DVec3]) -> Energy {
        Energy::from_state(&self.model, &[], positions, velocities)
    }

    fn largest_stable_step(&self, _: &Loads) -> Option<f64> {
        None
    }

    fn failure_advice(&self, dt: f64, _: &Loads) -> String {
        format!(
            "use a --dt below {dt}, less stiffness or more damping, or --engine cpu, and check the units of the mesh"
        )
    }

    fn check_prescribed_motion(&self, _: &[u32]) -> Result<()> {
        Ok(())
    }

    fn set_integrator(
        simulator: &mut RapierTets,
        kind: SolverKind,
        settings: CgSettings,
    ) -> Result<()> {
        check_kind(kind)?;
        simulator.worker.cancel_pending();
        simulator.progress = StepProgress::default();
        simulator
            .worker
            .set_progress(simulator.progress, Default::default());
        simulator.worker.body().set_settings(settings)?;
        simulator.changes += 1;
        simulator.upload_now()
    }

    fn add_term(_: &mut RapierTets, term: Arc<dyn NodeTerm>) -> Result<()> {
        Err(Error::Input(format!(
            "rapier does not support the term \"{}\"; for a floor, use a [[tool]] with a plane, or use --engine cpu",
            term.name()
        )))
    }

    fn cut(_: &mut RapierTets, _: &Blade) -> Result<TopologyChange> {
        Err(Error::Input(
            "rapier does not support cuts; use --engine cpu or gpu".into(),
        ))
    }

    fn force_balance(simulator: &RapierTets) -> Result<Option<ForceBalance>> {
        let model = &simulator.model.model;
        Ok(simulator.worker.body().force_balance(model))
    }

    fn contact(simulator: &mut RapierTets) -> Option<&mut dyn Contact> {
        Some(simulator)
    }

    fn reactions(simulator: &mut RapierTets) -> Option<&mut dyn Reactions> {
        Some(simulator)
    }

    fn joints(simulator: &mut RapierTets) -> Option<&mut dyn Joints> {
        Some(simulator)
    }
}

impl Contact for RapierTets {
    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        tool.check()?;
        let place = self.model.model.to_metres(tool.pose.position());
        let place = ToolPose::new(place, tool.pose.rotation());
        self.worker.body().add_tool(&tool, place)?;
        let id = self.loads.add_tool(tool.pose);
        self.model.tools.push(tool);
        self.changes += 1;
        Ok(id)
    }

    fn tools(&self) -> &[Tool] {
        &self.model.tools
    }

    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        self.finish()?;
        let nodes: BTreeSet<u32> = self.boundary().into_iter().flatten().collect();
        Ok(self.worker.body().tool_forces(&self.model.model, nodes))
    }

    fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<usize> {
        wanted.check()?;
        let mut body = self.worker.body();
        let through =
            count_intersecting_faces(&self.model.model, &self.boundary(), &body.positions())?;
        body.set_self_contact(wanted)?;
        drop(body);
        self.model.self_contact = Some(wanted);
        self.changes += 1;
        Ok(through)
    }

    fn self_contact(&self) -> Option<SelfContactSettings> {
        self.model.self_contact
    }
}

impl Reactions for RapierTets {
    fn nodal_forces(&mut self) -> Result<Vec<DVec3>> {
        self.sync_loads()?;
        self.finish()?;
        Ok(self.worker.body().forces(&self.model.model))
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        self.finish()?;
        Ok(self.worker.body().region_force(label))
    }
}

impl Joints for RapierTets {
    fn add_joint(&mut self, joint: Joint) -> Result<()> {
        joint.check()?;
        let at = self.model.model.to_metres(joint.anchor);
        self.worker.body().add_joint(&joint, at)?;
        self.changes += 1;
        Ok(())
    }
}
