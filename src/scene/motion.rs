//! A body that moves as its scene says.

use super::Scene;
use super::active_grab::ActiveGrab;
use super::reactions::NamedPins;
use super::simulator::SimulatorSetup;
use super::sleep::Sleep;
use super::time_dependent_loads::TimeDependentLoads;
use crate::Result;
use crate::cage::CageReport;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::grid::GridShape;
use crate::physics::{Engine, MemberReport, Reaction, Report, Simulator, SolverKind, StepProgress};
use glam::DVec3;

/// Steps between two looks at whether all is well, so that progress can be shown.
const STEPS_PER_POLL: u32 = 10;
/// The same of a grid body, whose steps are short, free and held.
const STEPS_OF_A_GRID: u32 = 256;
const STEPS_OF_A_HELD_GRID: u32 = 16;

/// A body that moves as its scene says.
pub struct Motion {
    /// The body, and what moves it.
    pub simulator: Box<dyn Simulator>,
    /// Step size, s.
    pub dt: f64,
    pub(super) attachments: Vec<ActiveGrab>,
    pub(super) progress: Option<StepProgress>,
    /// Steps that were asked for and not waited for, how many there are in all after these, and the
    /// body's count of changes from outside before them.
    pub(super) requested: Option<(u32, u64, u64)>,
    pub(super) sleep: Sleep,
    cage: Option<CageReport>,
    /// Whether its steps are those of a grid.
    grid: bool,
    /// Points, in file units, that pictures of the whole run should show.
    pub(super) motion_envelope: Option<Vec<DVec3>>,
    /// What is pinned, by name.
    pub(super) pins: Vec<NamedPins>,
    /// What acts on the body as time goes on.
    pub(super) time_dependent_loads: TimeDependentLoads,
    /// Tools that are regions of the mesh: their names.
    pub(super) dynamic_tools: Vec<String>,
}

impl Motion {
    /// The body and solver of `scene`, and in words what was assumed where it is silent. With a
    /// `shape` it is a grid body, whose mesh is `mesh`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for what makes no sense in the scene; otherwise what
    /// the device refuses.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        kind: SolverKind,
        mesh: TetMesh,
        shape: Option<GridShape>,
    ) -> Result<(Motion, Vec<String>)> {
        let (scene, mesh) = scene.with_dynamic_tools(mesh)?;
        let (setup, notes) = SimulatorSetup::new(gpu, &scene, kind, mesh, shape)?;
        Ok((Motion::of_setup(&scene, setup)?, notes))
    }

    /// A simulator that was set up for `scene`.
    pub(super) fn of_setup(scene: &Scene, setup: SimulatorSetup) -> Result<Motion> {
        let attachments = scene.grab.iter().map(ActiveGrab::new);
        Ok(Motion {
            simulator: setup.simulator,
            dt: setup.dt,
            attachments: attachments.collect::<Result<_>>()?,
            progress: None,
            requested: None,
            sleep: Sleep::new(scene.solver.sleep.unwrap_or(true)),
            cage: setup.cage,
            grid: setup.grid,
            motion_envelope: setup.motion_envelope,
            pins: setup.pins,
            time_dependent_loads: setup.actors,
            dynamic_tools: scene
                .carried
                .iter()
                .filter_map(|t| t.name.clone())
                .collect(),
        })
    }

    /// What the body exerts on each of its tools, by name: those that are led, then those that are
    /// carried.
    pub(super) fn tool_reactions(&mut self) -> Result<Vec<(String, Reaction)>> {
        let led = self.simulator.tool_forces()?;
        let names = self
            .time_dependent_loads
            .tools
            .iter()
            .map(|tool| tool.name.clone());
        let mut all: Vec<(String, Reaction)> = names.zip(led).collect();
        for name in &self.dynamic_tools {
            let names = &self.simulator.mesh().region_names;
            let found = names.iter().find(|(_, own)| *own == name);
            if let Some(label) = found.map(|(label, _)| *label)
                && let Some(force) = self.simulator.region_force(label)?
            {
                all.push((name.clone(), force));
            }
        }
        Ok(all)
    }

    /// Runs `steps` steps, telling `progress` how many are done.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) when the simulation failed; the body stays in its
    /// last good state.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        self.requested = None;
        while done < steps {
            let some = self.steps_at_once().min(steps - done);
            self.act(some)?;
            match self.sleep.is_asleep(self.simulator.change_count()) {
                true => self.sleep.skip(some, self.dt),
                false => {
                    self.progress = Some(self.simulator.run(some, self.dt)?);
                    let speed = self.simulator.rms_speed();
                    let touched = self.simulator.change_count();
                    self.sleep.update(speed, some, self.dt, touched);
                }
            }
            done += some;
            progress(done);
        }
        Ok(())
    }

    /// Asks for some of `steps` more steps, as many as may go by before loads of the scene change,
    /// and waits for none of them; where the body sleeps only time goes by. Once
    /// [`Motion::poll_steps`] says that earlier ones are done.
    ///
    /// # Errors
    /// As [`Motion::run`].
    pub fn request_steps(&mut self, steps: u32) -> Result<()> {
        let some = self.steps_at_once().min(steps);
        if some == 0 {
            return Ok(());
        }
        self.act(some)?;
        if self.sleep.is_asleep(self.simulator.change_count()) {
            self.sleep.skip(some, self.dt);
            return Ok(());
        }
        let done = self.simulator.progress()?.steps;
        self.simulator.advance(some, self.dt)?;
        let touched = self.simulator.change_count();
        self.requested = Some((some, done + u64::from(some), touched));
        Ok(())
    }

    /// Whether steps that [`Motion::request_steps`] asked for are still being computed, without waiting.
    ///
    /// # Errors
    /// As [`Motion::run`].
    pub fn poll_steps(&mut self) -> Result<bool> {
        let Some((some, goal, touched)) = self.requested else {
            return Ok(false);
        };
        let now = self.simulator.progress();
        // Of a failure nothing is left to wait for.
        let now = now.inspect_err(|_| self.requested = None)?;
        if now.steps < goal {
            return Ok(true);
        }
        self.requested = None;
        self.progress = Some(now);
        let speed = self.simulator.rms_speed();
        self.sleep.update(speed, some, self.dt, touched);
        Ok(false)
    }

    /// Has what acts on the body as time goes on be where it is after `steps` more steps.
    fn act(&mut self, steps: u32) -> Result<()> {
        let time = self.time() + f64::from(steps) * self.dt;
        for attachment in &mut self.attachments {
            attachment.update(self.simulator.as_mut(), time)?;
        }
        if self.time_dependent_loads.is_time_dependent() {
            let (now, dt) = (self.time(), self.dt);
            self.time_dependent_loads
                .apply(self.simulator.as_mut(), now, dt)?;
        }
        Ok(())
    }

    /// Whether the body is at rest and sleeps: time goes by, but nothing is simulated until it is
    /// touched. It falls asleep when its mean speed stays below a ten-thousandth of its size a
    /// second.
    pub fn asleep(&self) -> bool {
        self.sleep.asleep()
    }

    /// Steps that were not simulated because the body slept.
    pub fn steps_slept(&self) -> u64 {
        self.sleep.slept.0
    }

    /// Wakes the body: needed after what no count of its own tells of, such as forces written on
    /// the GPU.
    pub fn wake(&mut self) {
        self.sleep.wake();
    }

    /// Whether the body may fall asleep.
    pub fn may_sleep(&self) -> bool {
        self.sleep.allowed()
    }

    /// Lets the body fall asleep from now on, or not.
    pub fn set_sleep_allowed(&mut self, allowed: bool) {
        let slept = self.sleep.slept;
        self.sleep = Sleep::new(allowed);
        self.sleep.slept = slept;
    }

    /// How the cage turned out, where one carries the mesh.
    pub fn cage(&self) -> Option<CageReport> {
        self.cage
    }

    /// What each body is, where it is several.
    pub fn bodies(&self) -> Vec<MemberReport> {
        let bodies = self.simulator.bodies();
        bodies.map_or_else(Vec::new, |bodies| bodies.member_reports(self.dt))
    }

    /// How many rigid bodies there are in the body.
    pub fn rigid_bodies(&self) -> usize {
        let network = self.simulator.network();
        network.map_or(0, |n| n.elements.rigid.len())
    }

    /// Whether runs of it can be gone on with from checkpoints.
    pub fn has_state(&self) -> bool {
        self.simulator.has_state()
    }

    /// Metres in a unit of the mesh.
    pub fn length_unit(&self) -> f64 {
        self.simulator.loads().frame_and_unit().1
    }

    /// What computes its steps.
    pub fn engine(&self) -> Engine {
        self.simulator.engine()
    }

    /// Where the nodes of the mesh are, in file units, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.simulator.positions()
    }

    /// Puts the body back to where it rested, with the step and the tolerance of `scene`, which is
    /// otherwise the one it was made for.
    ///
    /// # Errors
    /// As [`Motion::new`].
    pub(crate) fn restart(&mut self, scene: &Scene) -> Result<()> {
        for attachment in &mut self.attachments {
            attachment.release(self.simulator.as_mut())?;
        }
        let attachments = scene.grab.iter().map(ActiveGrab::new);
        self.attachments = attachments.collect::<Result<_>>()?;
        self.dt = scene.solver.dt.unwrap_or(self.dt);
        self.progress = None;
        self.requested = None;
        self.sleep = Sleep::new(scene.solver.sleep.unwrap_or(true));
        self.simulator.restart()?;
        self.time_dependent_loads.restart(self.simulator.as_mut())?;
        let kind = self.simulator.integrator();
        self.simulator
            .set_integrator(kind, scene.conjugate_gradients())
    }

    /// Steps between two looks at whether all is well and where attachments are.
    fn steps_at_once(&self) -> u32 {
        match (
            self.attachments.is_empty() && !self.time_dependent_loads.is_time_dependent(),
            self.grid,
        ) {
            (true, false) => STEPS_PER_POLL,
            (true, true) => STEPS_OF_A_GRID,
            (false, false) => 1,
            (false, true) => STEPS_OF_A_HELD_GRID,
        }
    }

    /// Simulated time, in seconds.
    pub fn time(&self) -> f64 {
        self.progress.map_or(0.0, |p| p.time) + self.sleep.slept.1
    }

    /// Which solver it is.
    pub fn kind(&self) -> SolverKind {
        self.simulator.integrator()
    }

    /// How far the simulation came, as of the last [`Motion::run`].
    pub fn progress(&self) -> Option<StepProgress> {
        self.progress
    }

    /// Energies, volume and displacement, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn report(&self) -> Result<Report> {
        self.simulator.report()
    }
}
