//! The [`Simulator`] implementation of [`MultiBody`].

use super::{BodiesState, MultiBody};
use crate::gpu::Recorder;
use crate::mesh::{Blade, TetMesh, Topology};
use crate::physics::loads::force_balance::ForceSums;
use crate::physics::loads::grab::unknown_grab_error as unknown_grab;
use crate::physics::{
    Capability, CgSettings, Checkpointing, Energy, Engine, ExactPositions, ForceBalance, GrabId,
    GrabMode, GrabbedNode, Loads, Member, NodePositions, NodeTerm, Reaction, Reactions, Report,
    Simulator, SimulatorState, SolverKind, StepProgress, StepRecord, TopologyChange,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

impl Simulator for MultiBody {
    fn integrator(&self) -> SolverKind {
        self.members[0].simulator.integrator()
    }

    /// The GPU if any body is on it; otherwise the engine common to all, or the CPU.
    fn engine(&self) -> Engine {
        let mut engines = self.members.iter().map(|m| m.simulator.engine());
        let first = engines.next().unwrap_or(Engine::Cpu);
        engines.fold(first, |all, one| match (all, one) {
            (Engine::Gpu, _) | (_, Engine::Gpu) => Engine::Gpu,
            (all, one) if all == one => all,
            _ => Engine::Cpu,
        })
    }

    fn mesh(&self) -> &TetMesh {
        &self.whole.mesh
    }

    fn topology(&self) -> &Topology {
        &self.whole.topology
    }

    /// The mass of every node of the mesh; 0 for a mesh embedded in a cage.
    fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// Excludes the edges of cages.
    fn edge_nodes(&self) -> Vec<[u32; 2]> {
        let mut edges = Vec::new();
        for (member, places) in self.members.iter().zip(&self.whole.node_map) {
            if member.simulator.coarse_body().is_none() {
                let own = member.simulator.edge_nodes().into_iter();
                edges.extend(own.map(|ends| ends.map(|v| places[v as usize])));
            }
        }
        edges
    }

    fn members(&self) -> &[Member] {
        &self.members
    }

    /// If the first body uses this scheme already, each body keeps its own and takes the settings.
    fn set_integrator(&mut self, kind: SolverKind, settings: CgSettings) -> Result<()> {
        let keep = kind == self.integrator();
        for member in &mut self.members {
            let own = member.simulator.integrator();
            let kind = if keep { own } else { kind };
            member.named(|s| s.set_integrator(kind, settings))?;
        }
        Ok(())
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        for member in &mut self.members {
            member.named(|s| s.add_term(term.clone()))?;
        }
        Ok(())
    }

    /// Always `None`: each body takes as many substeps as it needs.
    fn largest_stable_step(&self) -> Option<f64> {
        None
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        self.advance_members(steps, dt, |s, steps, dt| s.advance(steps, dt))
    }

    fn set_waker(&mut self, waker: crate::physics::StepCallback) {
        for member in &mut self.members {
            member.simulator.set_waker(waker.clone());
        }
    }

    fn progress(&mut self) -> Result<StepProgress> {
        self.collect_progress(|s| s.progress())
    }

    fn finish(&mut self) -> Result<StepProgress> {
        self.collect_progress(|s| s.finish())
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.advance_members(steps, dt, |s, steps, dt| s.record(work, steps, dt))
    }

    /// The iterations of the body that needed the most.
    fn iterations(&self) -> Result<Vec<u32>> {
        let all = self.members.iter().map(|m| m.simulator.iterations());
        let all: Vec<Vec<u32>> = all.collect::<Result<_>>()?;
        let most = all.into_iter().max_by_key(|own| own.iter().sum::<u32>());
        Ok(most.unwrap_or_default())
    }

    fn update_nodes(&mut self, work: &mut Recorder) -> Result<()> {
        for (member, place) in self.members.iter_mut().zip(&mut self.places) {
            member.named(|s| s.update_nodes(work))?;
            place.record(work, member.simulator.nodes());
        }
        Ok(())
    }

    fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        self.gather(|s| s.positions())
    }

    fn held_by(&self, grab: GrabId) -> Result<Vec<GrabbedNode>> {
        let own = self.grabs.get(&grab).ok_or_else(unknown_grab)?;
        let mut all = Vec::new();
        for (i, own) in own {
            let places = &self.whole.node_map[*i];
            let held = self.members[*i].simulator.held_by(*own)?;
            all.extend(held.into_iter().map(|held| GrabbedNode {
                node: places[held.node as usize],
                ..held
            }));
        }
        Ok(all)
    }

    fn velocities(&self) -> Result<Vec<DVec3>> {
        self.gather(|s| s.velocities())
    }

    fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.scatter("positions", positions, |s, own| s.set_positions(own))
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        self.scatter("velocities", velocities, |s, own| s.set_velocities(own))
    }

    fn restart(&mut self) -> Result<()> {
        let mut each = self.members.iter_mut();
        each.try_for_each(|m| m.named(|s| s.restart()))
    }

    fn loads(&self) -> &Loads {
        &self.loads
    }

    fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    /// Grabs nodes of every body that has some within the radius.
    fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        self.sync_loads()?;
        let (mut held, mut refused) = (Vec::new(), None);
        for (i, member) in self.members.iter_mut().enumerate() {
            match member.named(|s| s.grab(centre, radius, grip)) {
                Ok(grab) => held.push((i, grab)),
                Err(error) => refused = refused.or(Some(error)),
            }
        }
        if let (true, Some(error)) = (held.is_empty(), refused) {
            return Err(error);
        }
        let id = GrabId::from_raw(self.next_grab);
        self.next_grab += 1;
        self.grabs.insert(id, held);
        Ok(id)
    }

    fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        let held = self.grabs.get(&grab).ok_or_else(unknown_grab)?;
        for (i, own) in held {
            self.members[*i].named(|s| s.set_target(*own, target))?;
        }
        Ok(())
    }

    fn release(&mut self, grab: GrabId) -> Result<usize> {
        let held = self.grabs.remove(&grab).ok_or_else(unknown_grab)?;
        let mut nodes = 0;
        for (i, own) in held {
            nodes += self.members[i].named(|s| s.release(own))?;
        }
        Ok(nodes)
    }

    fn cut(&mut self, blade: &Blade) -> Result<TopologyChange> {
        let caged = |m: &&Member| m.simulator.coarse_body().is_some();
        if let Some(member) = self.members.iter().find(caged) {
            return Err(Error::Input(format!(
                "cannot cut the bodies: body \"{}\" is embedded in a cage; remove its cage",
                member.name
            )));
        }
        self.sync_loads()?;
        let changes = self.members.iter_mut();
        let changes = changes.map(|m| m.named(|s| s.cut(blade)));
        let changes: Vec<TopologyChange> = changes.collect::<Result<_>>()?;
        let springs = changes.iter().map(|c| c.springs).sum();
        if changes.iter().all(TopologyChange::is_empty) {
            return Ok(TopologyChange::default());
        }
        let first = self.whole.mesh.nodes.len();
        let cut = self
            .whole
            .follow(&changes, &MultiBody::parts(&self.members));
        let frame = self.nodes.frame();
        let doubles = self.whole.mesh.nodes[first..].iter();
        let texels: Vec<[f32; 4]> = doubles
            .map(|p| frame.to_local(*p).extend(1.0).to_array())
            .collect();
        self.nodes.extend(&texels)?;
        self.rebuild_index()?;
        // The bodies have already distributed their loads in the same manner.
        self.loads.apply_cut(&cut, &self.masses);
        self.synced_loads = self.loads.versions;
        self.pinned = self.loads.pinned().to_vec();
        Ok(TopologyChange { mesh: cut, springs })
    }

    fn report(&self) -> Result<Report> {
        let (mut kinetic, mut elastic) = (0.0, 0.0);
        for member in &self.members {
            let energy = member.simulator.report()?.energy;
            kinetic += energy.kinetic;
            elastic += energy.elastic;
        }
        let energy = Energy {
            kinetic,
            elastic,
            total: kinetic + elastic,
        };
        let positions = self.positions()?;
        Ok(Report::from_positions(energy, &self.whole.mesh, &positions))
    }

    fn set_inversion_allowed(&mut self, allowed: bool) {
        for member in &mut self.members {
            member.simulator.set_inversion_allowed(allowed);
        }
    }

    fn force_balance(&self) -> Result<Option<ForceBalance>> {
        let mut sums = ForceSums::default();
        for member in &self.members {
            match member.simulator.force_balance()? {
                Some(balance) => sums.add_body(balance),
                None => return Ok(None),
            }
        }
        Ok(Some(sums.balance()))
    }

    /// The speed of the fastest body, relative to its size.
    fn rms_speed(&self) -> f64 {
        let speeds = self.members.iter().map(|m| m.simulator.rms_speed());
        speeds.fold(0.0, f64::max)
    }

    fn change_count(&self) -> u64 {
        let each = self.members.iter().map(|m| m.simulator.change_count());
        each.fold(self.loads.version(), u64::wrapping_add)
    }

    fn reactions(&mut self) -> Option<&mut dyn Reactions> {
        Some(self)
    }

    fn checkpoint(&self) -> Option<&dyn Checkpointing> {
        let mut members = self.members.iter();
        match members.all(|m| m.simulator.checkpoint().is_some()) {
            true => Some(self),
            false => None,
        }
    }

    fn checkpoint_mut(&mut self) -> Option<&mut dyn Checkpointing> {
        self.checkpoint()?;
        Some(self)
    }
}

impl Reactions for MultiBody {
    fn nodal_forces(&mut self) -> Result<Vec<DVec3>> {
        self.sync_loads()?;
        let mut all = vec![DVec3::ZERO; self.whole.mesh.nodes.len()];
        for (member, places) in self.members.iter_mut().zip(&self.whole.node_map) {
            let own = member.named(|s| {
                let forces = Capability::NodalForces.require(s.reactions())?;
                forces.nodal_forces()
            })?;
            for (v, own) in places.iter().zip(own) {
                all[*v as usize] = own;
            }
        }
        Ok(all)
    }

    fn region_force(&mut self, label: i64) -> Result<Option<Reaction>> {
        let Some((body, label)) = self.whole.region(label) else {
            return Ok(None);
        };
        self.sync_loads()?;
        self.members[body].named(|s| {
            let forces = Capability::NodalForces.require(s.reactions())?;
            forces.region_force(label)
        })
    }
}

impl Checkpointing for MultiBody {
    fn state(&self) -> Result<SimulatorState> {
        let members = self.members.iter().map(|m| {
            let saved = m.simulator.checkpoint();
            Capability::Checkpoints.require(saved)?.state()
        });
        Ok(SimulatorState::new(BodiesState {
            members: members.collect::<Result<_>>()?,
            loads: self.loads.state(),
            handed: self.synced_loads,
            gravity: self.gravity.to_array(),
            handed_pins: self.pinned.clone(),
            grabs: self.grabs.clone(),
            next_grab: self.next_grab,
        }))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let others = || {
            Error::Input(
                "the saved state is of other bodies; restore it with the same bodies".into(),
            )
        };
        let state: &BodiesState = state.get().ok_or_else(others)?;
        let grabs = || state.grabs.values().flatten();
        if state.members.len() != self.members.len()
            || state.handed_pins.len() != self.pinned.len()
            || grabs().any(|(i, _)| *i >= self.members.len())
        {
            return Err(others());
        }
        self.loads.set_state(&state.loads)?;
        for (member, state) in self.members.iter_mut().zip(&state.members) {
            member.named(|s| {
                let saved = s.checkpoint_mut();
                Capability::Checkpoints.require(saved)?.set_state(state)
            })?;
        }
        self.synced_loads = state.handed;
        self.gravity = state.gravity.into();
        self.pinned.clone_from(&state.handed_pins);
        self.grabs.clone_from(&state.grabs);
        self.next_grab = state.next_grab;
        Ok(())
    }

    fn exact_positions(&self) -> Result<ExactPositions> {
        let parts = self.members.iter().map(|m| {
            let saved = m.simulator.checkpoint();
            Capability::Checkpoints.require(saved)?.exact_positions()
        });
        Ok(ExactPositions {
            parts: parts.collect::<Result<_>>()?,
            ..ExactPositions::default()
        })
    }

    fn set_exact_positions(&mut self, pose: &ExactPositions) -> Result<()> {
        if pose.parts.len() != self.members.len() {
            return Err(Error::Input(
                "the saved positions are of other bodies; restore them with the same bodies".into(),
            ));
        }
        let mut each = self.members.iter_mut().zip(&pose.parts);
        each.try_for_each(|(m, pose)| {
            m.named(|s| {
                let saved = s.checkpoint_mut();
                Capability::Checkpoints
                    .require(saved)?
                    .set_exact_positions(pose)
            })
        })
    }
}

impl MultiBody {
    /// Requests `steps` steps of `dt` seconds from each body, split into substeps as needed.
    fn advance_members(
        &mut self,
        steps: u32,
        dt: f64,
        mut ask: impl FnMut(&mut dyn Simulator, u32, f64) -> Result<()>,
    ) -> Result<()> {
        self.sync_loads()?;
        for member in &mut self.members {
            let substeps = member.steps(dt);
            let Some(all) = steps.checked_mul(substeps) else {
                return Err(Error::Input(format!(
                    "body \"{}\" needs too many substeps: {substeps} per step of {dt} s; increase its time step, or decrease that of all bodies",
                    member.name
                )));
            };
            member.named(|s| ask(s, all, dt / f64::from(substeps)))?;
        }
        Ok(())
    }

    /// Collects the progress of all bodies, that of the slowest; returns the first error after all
    /// have been polled.
    fn collect_progress(
        &mut self,
        of: impl Fn(&mut dyn Simulator) -> Result<StepProgress>,
    ) -> Result<StepProgress> {
        let (mut all, mut failed) = (None::<StepProgress>, None);
        for member in &mut self.members {
            match member.named(&of) {
                Err(error) => failed = failed.or(Some(error)),
                Ok(own) => all = Some(all.map_or(own, |all| merge_progress(all, own))),
            }
        }
        match (failed, all) {
            (Some(error), _) => Err(error),
            (None, all) => Ok(all.unwrap_or_default()),
        }
    }
}

/// Combines the progress of two bodies.
fn merge_progress(a: StepProgress, b: StepProgress) -> StepProgress {
    StepProgress {
        steps: a.steps.min(b.steps),
        time: a.time.min(b.time),
        last: StepRecord {
            iterations: a.last.iterations.max(b.last.iterations),
            residual: a.last.residual.max(b.last.residual),
            kinetic: a.last.kinetic + b.last.kinetic,
            elastic: a.last.elastic + b.last.elastic,
        },
    }
}
