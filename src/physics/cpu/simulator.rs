//! A body of tets as a simulator, stepped on the CPU.

use super::guard::Failure;
use super::sending::{all_loads, send_loads};
use super::stepped::{LoadChange, Precision, TetBody};
use super::tools::check_contact;
use super::worker::{Errand, Refusal, Span, Worker};
use crate::gpu::{Gpu, Recorder};
use crate::mesh::{Blade, BoundaryFace, TetMesh, Topology, cut};
use crate::physics::loads::{LoadVersions, LoadsState};
use crate::physics::{
    Acting, ConjugateGradients, Energy, Engine, GrabId, Grip, LedId, LevelId, Loads, Material,
    NodeTerm, Nodes, Pose, Progress, Reaction, Report, SelfContact, Simulator, SimulatorState,
    SolverKind, SpringNetwork, Tool, ToolId, TopologyChange, Waker, advice, largest_stable_step,
    with_terms,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A body of tets on threads of the processor. Steps are done on a thread of its own, which shares
/// them out in rayon's global pool: do not wait for them from within that pool. What is drawn is
/// uploaded once a picture.
pub struct CpuTets {
    mesh: TetMesh,
    topology: Topology,
    material: Material,
    network: SpringNetwork,
    settings: ConjugateGradients,
    kind: SolverKind,
    loads: Loads,
    /// The loads that the worker has.
    sent: Option<LoadVersions>,
    terms: Vec<Arc<dyn NodeTerm>>,
    /// Pressures and muscles, in the order of their levels.
    acting: Vec<Acting>,
    tools: Vec<Tool>,
    self_contact: Option<SelfContact>,
    precision: Precision,
    worker: Worker<dyn TetBody>,
    nodes: Nodes,
    /// The positions that were uploaded.
    shown: u64,
    /// Counts changes of state and shape from outside.
    changes: u64,
    progress: Progress,
}

/// The state of a [`CpuTets`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CpuState {
    /// The body's own, packed: its numbers are those of the type that it computes in.
    body: Vec<u8>,
    loads: LoadsState,
    sent: Option<LoadVersions>,
    changes: u64,
    progress: Progress,
    span: Span,
    /// In how many parts the nodes are shared out among threads: sums depend on it.
    parts: usize,
}

impl CpuTets {
    /// `mesh` made of `material`, at rest, stepped by `kind` in numbers of that precision, its linear
    /// solves stopping as `settings` say. `gpu` is what it is drawn on.
    ///
    /// # Errors
    /// [`Error::Input`] for a material that makes no sense, [`Error::Gpu`] when the nodes do not
    /// fit the device.
    pub fn new(
        gpu: &Gpu,
        mesh: TetMesh,
        material: &Material,
        kind: SolverKind,
        settings: ConjugateGradients,
        precision: Precision,
    ) -> Result<CpuTets> {
        let network = SpringNetwork::new(&mesh, material)?;
        CpuTets::of_network(gpu, (mesh, network), material, (kind, settings), precision)
    }

    /// As [`CpuTets::new`], with masses and springs of one's own: those of a cage, for example.
    ///
    /// # Errors
    /// [`Error::Input`] when `network` is not one of `mesh`; otherwise as [`CpuTets::new`].
    pub fn of_network(
        gpu: &Gpu,
        (mesh, network): (TetMesh, SpringNetwork),
        material: &Material,
        (kind, settings): (SolverKind, ConjugateGradients),
        precision: Precision,
    ) -> Result<CpuTets> {
        if network.rest.len() != mesh.nodes.len() {
            return Err(Error::Input(format!(
                "masses of {} nodes are given for a mesh of {}",
                network.rest.len(),
                mesh.nodes.len()
            )));
        }
        let body = precision.tets(&network, (kind, settings), None)?;
        let nodes = Nodes::new(gpu, &mesh)?;
        Ok(CpuTets {
            topology: Topology::new(&mesh),
            material: material.clone(),
            loads: Loads::new(mesh.nodes.len(), nodes.frame(), network.length_unit),
            mesh,
            network,
            settings,
            kind,
            sent: None,
            terms: Vec::new(),
            acting: Vec::new(),
            tools: Vec::new(),
            self_contact: None,
            precision,
            worker: Worker::new(body),
            nodes,
            shown: 0,
            changes: 0,
            progress: Progress::default(),
        })
    }

    /// What is told of a step that was refused.
    fn error(&mut self, refusal: Refusal) -> Error {
        match refusal {
            Refusal::Wrong(error) => {
                // Loads that were refused are sent again.
                self.sent = None;
                error
            }
            Refusal::Failed(Failure::BadStep { h }, ..) => Error::Input(format!(
                "a time step of {h} s makes no sense for this body; give a positive number of seconds"
            )),
            Refusal::Failed(failure, dt, progress) => {
                self.progress = progress;
                Error::Solver {
                    solver: self.kind.name(),
                    step: progress.steps + 1,
                    time: progress.time,
                    cause: match failure {
                        Failure::RunawayEnergy { .. } => FailureCause::RunawayEnergy,
                        Failure::NotConverged { .. } | Failure::Pierced | Failure::Blocked => {
                            FailureCause::NotConverged
                        }
                        _ => FailureCause::NotFinite,
                    },
                    what: failure.to_string(),
                    advice: advice(
                        self.kind,
                        dt,
                        (&self.network, &self.terms),
                        self.loads.pinned(),
                    ),
                }
            }
        }
    }

    fn metres(&self, positions: &[DVec3]) -> Vec<DVec3> {
        positions
            .iter()
            .map(|p| self.network.to_metres(*p))
            .collect()
    }

    fn file(&self, metres: &[DVec3]) -> Vec<DVec3> {
        metres.iter().map(|x| self.network.to_file(*x)).collect()
    }

    fn speeds(&self, velocities: &[DVec3]) -> Vec<DVec3> {
        let unit = self.network.length_unit;
        velocities.iter().map(|v| *v * unit).collect()
    }

    /// Uploads the positions that were put out last, if they are new.
    fn upload(&mut self) -> Result<()> {
        let Some((version, positions)) = self.worker.published(self.shown) else {
            return Ok(());
        };
        self.shown = version;
        let unit = self.network.length_unit;
        let origin = self.network.frame.origin;
        let places: Vec<DVec3> = positions.iter().map(|x| origin + *x / unit).collect();
        self.nodes.set_positions(&places)
    }

    /// Uploads the positions of now.
    fn show(&mut self) -> Result<()> {
        self.worker.publish();
        self.upload()
    }

    /// A body of what the network is now, at rest, its nodes shared out in so many parts, or as
    /// many as suit it.
    fn body(&self, parts: Option<usize>) -> Result<Box<dyn TetBody>> {
        let how = (self.kind, self.settings);
        let mut body = self.precision.tets(&self.network, how, parts)?;
        for term in &self.terms {
            body.add_node_term(term.clone(), &self.network);
        }
        for (level, acting) in self.acting.iter().enumerate() {
            self.act(&mut *body, acting, level);
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
        body.take_over(LoadChange {
            gravity: self.loads.gravity(),
            levels: Some(self.loads.levels().to_vec()),
            pinned: Some(self.loads.pinned().to_vec()),
            ..LoadChange::default()
        })?;
        Ok(body)
    }

    /// The faces of the boundary, by their nodes.
    fn boundary(&self) -> Vec<[u32; 3]> {
        let faces = self.topology.boundary.iter();
        let nodes = |f: &BoundaryFace| self.topology.boundary_nodes(&self.mesh, *f);
        faces.map(nodes).collect()
    }

    /// Has `acting` act on `body`, made of this mesh and network.
    fn act(&self, body: &mut dyn TetBody, acting: &Acting, level: usize) {
        match acting {
            Acting::Pressure(faces) => {
                let (mesh, topology) = (&self.mesh, &self.topology);
                let faces = faces.iter().map(|f| topology.boundary_nodes(mesh, *f));
                body.add_pressure(&faces.collect::<Vec<_>>(), level);
            }
            Acting::Muscle(muscle) => {
                body.add_muscle(muscle, level, (&self.network, &self.mesh.tets));
            }
        }
    }

    /// Makes the body anew of what the network is now, in the state that it is in.
    fn remake(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let mut body = self.body(None)?;
        body.set_state(&self.metres(positions), &self.speeds(velocities))?;
        *self.worker.body() = body;
        self.sent = None;
        self.changes += 1;
        self.show()
    }

    /// Makes the body one in so many parts, where it is not; its state is to be set.
    fn share_out(&mut self, parts: usize) -> Result<()> {
        if self.worker.body().parts() != parts {
            let body = self.body(Some(parts))?;
            *self.worker.body() = body;
        }
        Ok(())
    }
}

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

    fn springs(&self) -> Vec<[u32; 2]> {
        self.network.springs.iter().map(|s| s.nodes).collect()
    }

    fn network(&self) -> Option<&SpringNetwork> {
        Some(&self.network)
    }

    fn set_integrator(&mut self, kind: SolverKind, settings: ConjugateGradients) -> Result<()> {
        if !self.tools.is_empty() {
            check_contact("tools", &self.network, kind)?;
        }
        if self.self_contact.is_some() {
            check_contact("itself", &self.network, kind)?;
        }
        self.worker.rest();
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        (self.kind, self.settings) = (kind, settings);
        self.progress = Progress::default();
        self.worker.set_progress(self.progress, Span::default());
        self.remake(&positions, &velocities)
    }

    fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        let mut body = self.worker.body();
        body.add_node_term(term.clone(), &self.network);
        self.terms.push(term);
        self.changes += 1;
        Ok(())
    }

    fn add_acting(&mut self, acting: Acting) -> Result<LevelId> {
        acting.check(&self.mesh, &self.network)?;
        let level = self.acting.len();
        self.act(&mut **self.worker.body(), &acting, level);
        self.acting.push(acting);
        self.changes += 1;
        Ok(self.loads.add_level())
    }

    fn set_level(&mut self, id: LevelId, level: f64) -> Result<()> {
        let acting = self.acting.get(id.0).ok_or_else(|| {
            Error::Input(format!("nothing acts on this body at the level {}", id.0))
        })?;
        acting.check_level(level)?;
        self.loads.set_level(id, level);
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

    fn set_self_contact(&mut self, wanted: SelfContact) -> Result<usize> {
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

    fn self_contact(&self) -> Option<SelfContact> {
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

    fn lead(&mut self, nodes: &[u32]) -> Result<LedId> {
        let mut bones = self.network.elements.rigid.iter();
        if bones.any(|b| nodes.iter().any(|v| b.nodes.binary_search(v).is_ok())) {
            return Err(Error::Input(
                "nodes of a rigid region cannot be led along; move soft ones, or hold the region by a grab and move that".into(),
            ));
        }
        let positions = self.positions()?;
        let place = |v: &u32| positions.get(*v as usize).copied();
        let places: Option<Vec<DVec3>> = nodes.iter().map(place).collect();
        self.loads.lead(nodes, &places.unwrap_or_default())
    }

    fn largest_stable_step(&self) -> Option<f64> {
        let limit = largest_stable_step(&self.network, self.loads.pinned(), self.kind)?;
        Some(with_terms(limit, &self.network, &self.terms))
    }

    fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(Error::Input(format!(
                "a time step of {dt} s makes no sense for this body; give a positive number of seconds"
            )));
        }
        send_loads(&self.loads, &mut self.sent, &mut self.worker)?;
        match steps {
            0 => Ok(()),
            steps => self.worker.ask(Errand::Steps(steps, dt)),
        }
    }

    fn set_waker(&mut self, waker: Waker) {
        self.worker.set_waker(waker);
    }

    fn progress(&mut self) -> Result<Progress> {
        self.progress = match self.worker.progress() {
            Ok(progress) => progress,
            Err(refusal) => return Err(self.error(refusal)),
        };
        Ok(self.progress)
    }

    fn finish(&mut self) -> Result<Progress> {
        self.progress = match self.worker.finish() {
            Ok(progress) => progress,
            Err(refusal) => return Err(self.error(refusal)),
        };
        Ok(self.progress)
    }

    fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        self.run(steps, dt)?;
        self.publish(work)
    }

    fn iterations(&self) -> Result<Vec<u32>> {
        Ok(self.worker.iterations())
    }

    fn publish(&mut self, _: &mut Recorder) -> Result<()> {
        self.upload()
    }

    fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    fn positions(&self) -> Result<Vec<DVec3>> {
        let metres = self.worker.body().positions();
        Ok(self.file(&metres))
    }

    fn forces(&mut self) -> Result<Vec<DVec3>> {
        send_loads(&self.loads, &mut self.sent, &mut self.worker)?;
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
        self.show()
    }

    fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let velocities = self.speeds(velocities);
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

    fn grab(&mut self, centre: DVec3, radius: f64, grip: Grip) -> Result<GrabId> {
        // As they were before a step under way: nobody waits for that.
        let positions = self.file(&self.worker.positions());
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
        self.network.follow(&self.mesh, &self.material, &done)?;
        self.acting.iter_mut().for_each(|a| a.follow(&done));
        for [_, old] in &done.doubled {
            positions.push(positions[*old as usize]);
            velocities.push(velocities[*old as usize]);
        }
        self.loads.follow(&done, &self.network.masses);
        let blank = vec![[0.0; 4]; done.doubled.len()];
        self.nodes.extend(&blank)?;
        self.remake(&positions, &velocities)?;
        Ok(TopologyChange {
            mesh: done,
            springs: 0,
        })
    }

    fn report(&self) -> Result<Report> {
        let positions = self.positions()?;
        let velocities = self.velocities()?;
        let energy = Energy::of(&self.network, &self.terms, &positions, &velocities);
        Ok(Report::of_positions(energy, &self.mesh, &positions))
    }

    fn speed(&self) -> f64 {
        if self.progress.steps == 0 {
            return f64::INFINITY;
        }
        let mass: f64 = self.network.masses.iter().sum();
        let speed = (2.0 * self.progress.last.kinetic.max(0.0) / mass).sqrt();
        speed / (self.network.frame.scale * self.network.length_unit)
    }

    fn touched(&self) -> u64 {
        self.changes + self.loads.version()
    }

    fn state(&self) -> Result<SimulatorState> {
        let (body, parts) = {
            let body = self.worker.body();
            (body.packed()?, body.parts())
        };
        Ok(SimulatorState::Cpu(Box::new(CpuState {
            body,
            loads: self.loads.state(),
            sent: self.sent,
            changes: self.changes,
            progress: self.progress,
            span: self.worker.span(),
            parts,
        })))
    }

    fn set_state(&mut self, state: &SimulatorState) -> Result<()> {
        let SimulatorState::Cpu(state) = state else {
            return Err(Error::Input(
                "the state of another kind of body, or of another engine".into(),
            ));
        };
        self.worker.rest();
        self.loads.set_state(&state.loads)?;
        self.share_out(state.parts)?;
        {
            let mut body = self.worker.body();
            body.take_over(all_loads(&self.loads))?;
            body.resume(&state.body)?;
        }
        self.sent = state.sent;
        self.changes = state.changes;
        self.progress = state.progress;
        self.worker.set_progress(state.progress, state.span);
        self.show()
    }

    fn pose(&self) -> Result<Pose> {
        Ok(Pose {
            exact: self.worker.body().displacements(),
            ..Pose::default()
        })
    }

    fn set_pose(&mut self, pose: &Pose) -> Result<()> {
        self.worker.body().set_displacements(&pose.exact)?;
        self.show()
    }
}
