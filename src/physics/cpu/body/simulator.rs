//! The model of tetrahedral bodies stepped on the CPU, and the capabilities of such bodies.

use super::tets::{CpuState, CpuTetModel, CpuTets};
use crate::mesh::{Blade, LocalFrame, cut_elements};
use crate::physics::cpu::contact::parameters::check_contact;
use crate::physics::cpu::runtime::checkpoint::ResumableModel;
use crate::physics::cpu::runtime::steppable::TetBody;
use crate::physics::cpu::runtime::threaded_simulator::BodyModel;
use crate::physics::cpu::runtime::worker::StepClock;
use crate::physics::simulator::checkpoint::Checkpointing;
use crate::physics::simulator::contact::Contact;
use crate::physics::simulator::gradients::Gradients;
use crate::physics::simulator::reactions::Reactions;
use crate::physics::simulator::scaled_loads::ScaledLoads;
use crate::physics::{
    AmplitudeId, CgSettings, DiscreteModel, Energy, Engine, ForceBalance, Loads, NodeTerm,
    Reaction, ScaledLoad, SelfContactSettings, Simulator, SolverKind, StepProgress, Tool, ToolId,
    TopologyChange, largest_stable_step, limit_with_terms, time_step_advice,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

impl BodyModel for CpuTetModel {
    type Body = dyn TetBody;

    const ENGINE: Engine = Engine::Cpu;

    fn integrator(&self) -> SolverKind {
        self.kind
    }

    fn frame(&self) -> LocalFrame {
        self.network.frame
    }

    fn length_unit(&self) -> f64 {
        self.network.length_unit
    }

    fn masses(&self) -> &[f64] {
        &self.network.masses
    }

    fn discrete_model(&self) -> Option<&DiscreteModel> {
        Some(&self.network)
    }

    fn energy(&self, positions: &[DVec3], velocities: &[DVec3]) -> Energy {
        Energy::from_state(&self.network, &self.terms, positions, velocities)
    }

    fn largest_stable_step(&self, loads: &Loads) -> Option<f64> {
        let limit = largest_stable_step(&self.network, loads.pinned(), self.kind)?;
        Some(limit_with_terms(limit, &self.network, &self.terms))
    }

    fn failure_advice(&self, dt: f64, loads: &Loads) -> String {
        time_step_advice(self.kind, dt, (&self.network, &self.terms), loads.pinned())
    }

    fn check_prescribed_motion(&self, nodes: &[u32]) -> Result<()> {
        let mut bones = self.network.rigid_bodies().iter();
        match bones.any(|b| nodes.iter().any(|v| b.nodes.binary_search(v).is_ok())) {
            true => Err(Error::Input(
                "cannot prescribe the motion of nodes of a rigid region; move soft nodes, or hold the region by a grab and move the grab".into(),
            )),
            false => Ok(()),
        }
    }

    fn set_integrator(
        simulator: &mut CpuTets,
        kind: SolverKind,
        settings: CgSettings,
    ) -> Result<()> {
        if !simulator.model.tools.is_empty() {
            check_contact("tools", &simulator.model.network, kind)?;
        }
        if simulator.model.self_contact.is_some() {
            check_contact("itself", &simulator.model.network, kind)?;
        }
        simulator.worker.cancel_pending();
        let (positions, velocities) = (simulator.positions()?, simulator.velocities()?);
        (simulator.model.kind, simulator.model.settings) = (kind, settings);
        simulator.progress = StepProgress::default();
        simulator
            .worker
            .set_progress(simulator.progress, StepClock::default());
        simulator.rebuild_body(&positions, &velocities)
    }

    fn add_term(simulator: &mut CpuTets, term: Arc<dyn NodeTerm>) -> Result<()> {
        let mut body = simulator.worker.body();
        body.add_node_term(term.clone(), &simulator.model.network);
        simulator.model.terms.push(term);
        simulator.changes += 1;
        Ok(())
    }

    fn cut(simulator: &mut CpuTets, blade: &Blade) -> Result<TopologyChange> {
        simulator.finish()?;
        let (mut positions, mut velocities) = (simulator.positions()?, simulator.velocities()?);
        let done = cut_elements(
            &mut simulator.mesh,
            &mut simulator.topology,
            &positions,
            blade,
            simulator.model.material.order,
        )?;
        if done.is_empty() {
            return Ok(TopologyChange::default());
        }
        simulator
            .model
            .network
            .apply_cut(&simulator.mesh, &simulator.model.material, &done)?;
        simulator
            .model
            .scaled_loads
            .iter_mut()
            .for_each(|a| a.apply_cut(&done));
        for [_, old] in &done.duplicated_nodes {
            positions.push(positions[*old as usize]);
            velocities.push(velocities[*old as usize]);
        }
        simulator
            .loads
            .apply_cut(&done, &simulator.model.network.masses);
        let blank = vec![[0.0; 4]; done.duplicated_nodes.len()];
        simulator.nodes.extend(&blank)?;
        simulator.rebuild_body(&positions, &velocities)?;
        Ok(TopologyChange {
            mesh: done,
            springs: 0,
        })
    }

    fn force_balance(simulator: &CpuTets) -> Result<Option<ForceBalance>> {
        let stiffness = simulator.model.network.nodal_stiffness();
        Ok(Some(simulator.worker.body().force_balance(&stiffness)))
    }

    fn set_inversion_allowed(simulator: &mut CpuTets, allowed: bool) {
        simulator.model.inversion_allowed = allowed;
        simulator.worker.body().set_inversion_allowed(allowed);
    }

    fn contact(simulator: &mut CpuTets) -> Option<&mut dyn Contact> {
        Some(simulator)
    }

    fn reactions(simulator: &mut CpuTets) -> Option<&mut dyn Reactions> {
        Some(simulator)
    }

    fn scaled_loads(simulator: &mut CpuTets) -> Option<&mut dyn ScaledLoads> {
        Some(simulator)
    }

    fn gradients(simulator: &mut CpuTets) -> Option<&mut dyn Gradients> {
        Some(simulator)
    }

    fn checkpoint(simulator: &CpuTets) -> Option<&dyn Checkpointing> {
        Some(simulator)
    }

    fn checkpoint_mut(simulator: &mut CpuTets) -> Option<&mut dyn Checkpointing> {
        Some(simulator)
    }
}

impl ResumableModel for CpuTetModel {
    type State = CpuState;

    fn rebuild(simulator: &CpuTets, parts: usize) -> Result<Box<dyn TetBody>> {
        simulator.body(Some(parts))
    }

    fn exact_positions(body: &dyn TetBody) -> Vec<[f64; 3]> {
        body.displacements()
    }

    fn set_exact_positions(body: &mut dyn TetBody, positions: &[[f64; 3]]) -> Result<()> {
        body.set_displacements(positions)
    }
}

impl Contact for CpuTets {
    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        tool.check()?;
        check_contact("tools", &self.model.network, self.model.kind)?;
        let faces = self.boundary();
        self.worker
            .body()
            .add_tool(&tool, &faces, &self.model.network);
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
        let forces = self.worker.body().tool_forces();
        let reaction = |[force, moment]: [DVec3; 2]| Reaction { force, moment };
        Ok(forces.into_iter().map(reaction).collect())
    }

    fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<usize> {
        wanted.check()?;
        check_contact("itself", &self.model.network, self.model.kind)?;
        let faces = self.boundary();
        let mut body = self.worker.body();
        let through = body.set_self_contact(&wanted, &faces, &self.model.network);
        drop(body);
        self.model.self_contact = Some(wanted);
        self.changes += 1;
        Ok(through)
    }

    fn self_contact(&self) -> Option<SelfContactSettings> {
        self.model.self_contact
    }
}

impl Reactions for CpuTets {
    fn nodal_forces(&mut self) -> Result<Vec<DVec3>> {
        self.sync_loads()?;
        self.finish()?;
        let mut forces = self.worker.body().forces();
        let rigid = self.model.network.rigid_bodies().iter();
        for v in rigid.flat_map(|body| &body.nodes) {
            forces[*v as usize] = DVec3::NAN;
        }
        Ok(forces)
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        let mut bodies = self.model.network.rigid_bodies().iter();
        let Some(b) = bodies.position(|body| body.labels.contains(&label)) else {
            return Ok(None);
        };
        self.finish()?;
        let forces = self.worker.body().rigid_forces();
        Ok(forces.get(b).map(|[force, moment]| Reaction {
            force: *force,
            moment: *moment,
        }))
    }
}

impl ScaledLoads for CpuTets {
    fn add_scaled_load(&mut self, acting: ScaledLoad) -> Result<AmplitudeId> {
        acting.check(&self.mesh, &self.model.network)?;
        let level = self.model.scaled_loads.len();
        self.apply_scaled_load(&mut **self.worker.body(), &acting, level);
        self.model.scaled_loads.push(acting);
        self.changes += 1;
        Ok(self.loads.add_amplitude())
    }

    fn set_amplitude(&mut self, id: AmplitudeId, level: f64) -> Result<()> {
        let acting = self.model.scaled_loads.get(id.0).ok_or_else(|| {
            Error::Input(format!(
                "unknown amplitude {}: this body has no such pressure or muscle",
                id.0
            ))
        })?;
        acting.check_amplitude(level)?;
        self.loads.set_amplitude(id, level);
        Ok(())
    }
}
