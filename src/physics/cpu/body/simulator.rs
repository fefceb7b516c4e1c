//! The [`Simulator`] implementation of tetrahedral bodies stepped on the CPU.

use super::tets::{CpuState, CpuTets};

use crate::gpu::Recorder;
use crate::mesh::{Blade, TetMesh, Topology, cut};
use crate::physics::cpu::contact::parameters::check_contact;
use crate::physics::cpu::runtime::load_sync::{full_load_update, send_loads};
use crate::physics::cpu::runtime::worker::{StepClock, WorkerCommand};
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    AmplitudeId, CgSettings, DiscreteModel, Energy, Engine, ExactPositions, ForceBalance, GrabId,
    GrabMode, Loads, NodePositions, NodeTerm, PrescribedMotionId, Reaction, Report, ScaledLoad,
    SelfContactSettings, Simulator, SimulatorState, SolverKind, StepCallback, StepProgress, Tool,
    ToolId, TopologyChange, largest_stable_step, limit_with_terms,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

impl Simulator for CpuTets {
    fn integrator(&self) -> SolverKind {
        self.kind
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
        &self.network.masses
    }

    fn spring_pairs(&self) -> Vec<[u32; 2]> {
        self.network.springs.iter().map(|s| s.nodes).collect()
    }

    fn network(&self) -> Option<&DiscreteModel> {
        Some(&self.network)
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        if !self.tools.is_empty() {
            check_contact("tools", &self.network, kind)?;
        }
        if self.self_contact.is_some() {
            check_contact("itself", &self.network, kind)?;
        }
        self.worker.cancel_pending();
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        (self.kind, self.settings) = (kind, settings);
        self.progress = StepProgress::default();
        self.worker
            .set_progress(self.progress, StepClock::default());
        self.rebuild_body(&positions, &velocities)
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        let mut body = self.worker.body();
        body.add_node_term(term.clone(), &self.network);
        self.terms.push(term);
        self.changes += 1;
        Ok(())
    }

    fn add_scaled_load(&mut self, acting: ScaledLoad) -> Result<AmplitudeId> {
        acting.check(&self.mesh, &self.network)?;
        let level = self.scaled_loads.len();
        self.apply_scaled_load(&mut **self.worker.body(), &acting, level);
        self.scaled_loads.push(acting);
        self.changes += 1;
        Ok(self.loads.add_amplitude())
    }

    fn set_amplitude(&mut self, id: AmplitudeId, level: f64) -> Result<()> {
        let acting = self.scaled_loads.get(id.0).ok_or_else(|| {
            Error::Input(format!(
                "unknown amplitude {}: this body has no such pressure or muscle",
                id.0
            ))
        })?;
        acting.check_amplitude(level)?;
        self.loads.set_amplitude(id, level);
        Ok(())
    }

    fn add_tool(&mut self, tool: Tool) -> Result<ToolId> {
        tool.check()?;
        check_contact("tools", &self.network, self.kind)?;
        let faces = self.boundary();
        self.worker.body().add_tool(&tool, &faces, &self.network);
        let id = self.loads.add_tool(tool.pose);
        self.tools.push(tool);
        self.changes += 1;
        Ok(id)
    }

    fn tools(&self) -> &[Tool] {
        &self.tools
    }

    fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<usize> {
        wanted.check()?;
        check_contact("itself", &self.network, self.kind)?;
        let faces = self.boundary();
        let mut body = self.worker.body();
        let through = body.set_self_contact(&wanted, &faces, &self.network);
        drop(body);
        self.self_contact = Some(wanted);
        self.changes += 1;
        Ok(through)
    }

    fn self_contact(&self) -> Option<SelfContactSettings> {
        self.self_contact
    }

    fn tool_forces(&mut self) -> Result<Vec<Reaction>> {
        self.finish()?;
        let forces = self.worker.body().tool_forces();
        let reaction = |[force, moment]: [DVec3; 2]| Reaction { force, moment };
        Ok(forces.into_iter().map(reaction).collect())
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        let mut bodies = self.network.elements.rigid.iter();
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

    fn add_prescribed_motion(&mut self, nodes: &[u32]) -> Result<PrescribedMotionId> {
        let mut bones = self.network.elements.rigid.iter();
        if bones.any(|b| nodes.iter().any(|v| b.nodes.binary_search(v).is_ok())) {
            return Err(Error::Input(
                "cannot prescribe the motion of nodes of a rigid region; move soft nodes, or hold the region by a grab and move the grab".into(),
            ));
        }
        let positions = self.positions()?;
        let place = |v: &u32| positions.get(*v as usize).copied();
        let places: Option<Vec<DVec3>> = nodes.iter().map(place).collect();
        self.loads
            .add_prescribed_motion(nodes, &places.unwrap_or_default())
    }

    fn largest_stable_step(&self) -> Option<f64> {
        let limit = largest_stable_step(&self.network, self.loads.pinned(), self.kind)?;
        Some(limit_with_terms(limit, &self.network, &self.terms))
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
        Ok(self.worker.iterations())
    }

    fn update_nodes(&mut self, _: &mut Recorder) -> Result<()> {
        self.upload()
    }

    fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let metres = self.worker.body().positions();
        Ok(self.to_file_units(&metres))
    }

    fn forces(&mut self) -> Result<Vec<DVec3>> {
        send_loads(&self.loads, &mut self.synced_loads, &mut self.worker)?;
        self.finish()?;
        let mut forces = self.worker.body().forces();
        let rigid = self.network.elements.rigid.iter();
        for v in rigid.flat_map(|body| &body.nodes) {
            forces[*v as usize] = DVec3::NAN;
        }
        Ok(forces)
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        let unit = self.network.length_unit;
        let metres = self.worker.body().velocities();
        Ok(metres.iter().map(|v| *v / unit).collect())
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.nodes
            .check("positions", positions, |p| self.network.frame.to_local(p))?;
        let metres = self.metres(positions);
        {
            let mut body = self.worker.body();
            let velocities = body.velocities();
            body.set_state(&metres, &velocities)?;
        }
        self.changes += 1;
        self.upload_now()
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let velocities = self.velocities_in_metres(velocities);
        let mut body = self.worker.body();
        let positions = body.positions();
        body.set_state(&positions, &velocities)?;
        self.changes += 1;
        Ok(())
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
        self.loads
            .grab(&positions, |_| true, (centre, radius), grip)
    }

    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange> {
        self.finish()?;
        let (mut positions, mut velocities) = (self.positions()?, self.velocities()?);
        let done = cut(&mut self.mesh, &mut self.topology, &positions, blade)?;
        if done.is_empty() {
            return Ok(TopologyChange::default());
        }
        self.network.apply_cut(&self.mesh, &self.material, &done)?;
        self.scaled_loads
            .iter_mut()
            .for_each(|a| a.apply_cut(&done));
        for [_, old] in &done.duplicated_nodes {
            positions.push(positions[*old as usize]);
            velocities.push(velocities[*old as usize]);
        }
        self.loads.apply_cut(&done, &self.network.masses);
        let blank = vec![[0.0; 4]; done.duplicated_nodes.len()];
        self.nodes.extend(&blank)?;
        self.rebuild_body(&positions, &velocities)?;
        Ok(TopologyChange {
            mesh: done,
            springs: 0,
        })
    }

    fn report(&self) -> Result<Report> {
        let positions = self.positions()?;
        let velocities = self.velocities()?;
        let energy = Energy::from_state(&self.network, &self.terms, &positions, &velocities);
        Ok(Report::from_positions(energy, &self.mesh, &positions))
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        self.inversion_allowed = allowed;
        self.worker.body().set_inversion_allowed(allowed);
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        let stiffness = self.network.nodal_stiffness();
        Ok(Some(self.worker.body().force_balance(&stiffness)))
    }

    fn rms_speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.network.masses.iter().sum();
        let speed = (2.0 * self.progress.last.kinetic.max(0.0) / mass).sqrt();
        speed / (self.network.frame.scale * self.network.length_unit)
    }

    fn change_count(&self) -> u64 {
        self.changes + self.loads.version()
    }

    fn state(&self) -> Result<SimulatorState> {
        let (body, parts) = {
            let body = self.worker.body();
            (body.serialise_state()?, body.parts())
        };
        Ok(SimulatorState::new(CpuState {
            body,
            loads: self.loads.state(),
            sent: self.synced_loads,
            changes: self.changes,
            progress: self.progress,
            span: self.worker.span(),
            parts,
        }))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let state: &CpuState = state.expect()?;
        self.worker.cancel_pending();
        self.loads.set_state(&state.loads)?;
        self.repartition(state.parts)?;
        {
            let mut body = self.worker.body();
            body.apply_loads(full_load_update(&self.loads))?;
            body.resume(&state.body)?;
        }
        self.synced_loads = state.sent;
        self.changes = state.changes;
        self.progress = state.progress;
        self.worker.set_progress(state.progress, state.span);
        self.upload_now()
    }

    fn pose(&self) -> Result<ExactPositions> {
        Ok(ExactPositions {
            displacements: self.worker.body().displacements(),
            ..ExactPositions::default()
        })
    }

    fn set_pose(&mut self, pose: &ExactPositions) -> Result<()> {
        self.worker.body().set_displacements(&pose.displacements)?;
        self.upload_now()
    }
}
