//! The simulated motion of a scene's body.

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

/// Steps between two polls of the simulator, so that progress can be shown.
const STEPS_PER_POLL: u32 = 10;
/// Steps between polls of a grid body, which has short steps: free and grabbed.
const STEPS_OF_A_GRID: u32 = 256;
const STEPS_OF_A_HELD_GRID: u32 = 16;

/// The simulated body of a scene.
pub struct Motion {
    /// The body and its solver.
    pub simulator: Box<dyn Simulator>,
    /// Time step, s.
    pub dt: f64,
    pub(super) attachments: Vec<ActiveGrab>,
    pub(super) progress: Option<StepProgress>,
    /// Requested steps that are not finished: their number, the total number of steps after them,
    /// and the body's counter of external changes before them.
    pub(super) requested: Option<(u32, u64, u64)>,
    pub(super) sleep: Sleep,
    cage: Option<CageReport>,
    /// Whether it is a grid body.
    grid: bool,
    /// Points, in file units, that the view of the whole run should contain.
    pub(super) motion_envelope: Option<Vec<DVec3>>,
    /// Named pins.
    pub(crate) pins: Vec<NamedPins>,
    /// Time-dependent loads.
    pub(super) time_dependent_loads: TimeDependentLoads,
    /// Names of the dynamic tools, which are regions of the mesh.
    pub(super) dynamic_tools: Vec<String>,
}

impl Motion {
    /// Creates the body and solver of `scene`, and notes of the automatic choices. With a `shape`
    /// it is a grid body, whose mesh is `mesh`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an invalid scene; otherwise an error of the
    /// device.
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

    /// Creates the motion of a simulator that was set up for `scene`.
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

    /// Returns the reaction of the body on each tool by name: kinematic tools, then dynamic ones.
    pub(crate) fn tool_reactions(&mut self) -> Result<Vec<(String, Reaction)>> {
        let contact = self.simulator.contact();
        let tool_forces = contact.map_or(Ok(Vec::new()), |contact| contact.tool_forces())?;
        let names = self
            .time_dependent_loads
            .tools
            .iter()
            .map(|tool| tool.name.clone());
        let mut all: Vec<(String, Reaction)> = names.zip(tool_forces).collect();
        for name in &self.dynamic_tools {
            let names = &self.simulator.mesh().region_names;
            let found = names.iter().find(|(_, own)| *own == name);
            if let Some(label) = found.map(|(label, _)| *label)
                && let Some(forces) = self.simulator.reactions()
                && let Some(force) = forces.region_force(label)?
            {
                all.push((name.clone(), force));
            }
        }
        Ok(all)
    }

    /// Runs `steps` steps and reports the number done to `progress`.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if the simulation failed; the body keeps its last
    /// valid state.
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
                    let touched = self.simulator.change_count();
                    self.sleep.update(self.simulator.as_ref(), some, touched)?;
                }
            }
            done += some;
            progress(done);
        }
        Ok(())
    }

    /// Starts up to `steps` more steps, as many as are possible until loads of the scene change,
    /// without waiting; if the body sleeps only the time advances. Earlier steps must be finished
    /// according to [`Motion::poll_steps`].
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

    /// Whether steps started by [`Motion::request_steps`] are still being computed; does not wait.
    ///
    /// # Errors
    /// As [`Motion::run`].
    pub fn poll_steps(&mut self) -> Result<bool> {
        let Some((some, goal, touched)) = self.requested else {
            return Ok(false);
        };
        let now = self.simulator.progress();
        // After a failure there are no steps to wait for.
        let now = now.inspect_err(|_| self.requested = None)?;
        if now.steps < goal {
            return Ok(true);
        }
        self.requested = None;
        self.progress = Some(now);
        self.sleep.update(self.simulator.as_ref(), some, touched)?;
        Ok(false)
    }

    /// Applies the time-dependent loads for the time after `steps` more steps.
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

    /// Whether the body sleeps: time advances without simulation until the body is disturbed. It
    /// falls asleep when its static forces are balanced and its kinetic energy is negligible; with
    /// tools on the GPU or rapier, where the balance is unknown, it stays awake.
    pub fn asleep(&self) -> bool {
        self.sleep.asleep()
    }

    /// Returns the number of steps skipped while the body slept.
    pub fn steps_slept(&self) -> u64 {
        self.sleep.skipped.0
    }

    /// Wakes the body: needed after changes that it does not count, such as forces written on the
    /// GPU.
    pub fn wake(&mut self) {
        self.sleep.wake();
    }

    /// Whether the body may fall asleep.
    pub fn may_sleep(&self) -> bool {
        self.sleep.allowed()
    }

    /// Sets whether the body may fall asleep.
    pub fn set_sleep_allowed(&mut self, allowed: bool) {
        let skipped = self.sleep.skipped;
        self.sleep = Sleep::new(allowed);
        self.sleep.skipped = skipped;
    }

    /// Returns the report of the cage, if the mesh is embedded in one.
    pub fn cage(&self) -> Option<CageReport> {
        self.cage
    }

    /// Returns a report for each body, if there are several.
    pub fn bodies(&self) -> Vec<MemberReport> {
        let members = self.simulator.members().iter();
        members.map(|m| m.report(self.dt)).collect()
    }

    /// Returns the number of rigid bodies in the body.
    pub fn rigid_bodies(&self) -> usize {
        let model = self.simulator.model();
        model.map_or(0, |n| n.rigid_bodies().len())
    }

    /// Whether its runs can be resumed from checkpoints.
    pub fn has_state(&self) -> bool {
        self.simulator.checkpoint().is_some()
    }

    /// Returns the length unit of the mesh, in metres.
    pub fn length_unit(&self) -> f64 {
        self.simulator.loads().frame_and_unit().1
    }

    /// Returns the engine of its steps.
    pub fn engine(&self) -> Engine {
        self.simulator.engine()
    }

    /// Reads back the node positions of the mesh, in file units.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.simulator.positions()
    }

    /// Resets the body to rest, with the time step and tolerance of `scene`, which must otherwise
    /// equal the scene that it was created for.
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

    /// Returns the number of steps between two polls of the simulator and updates of the
    /// attachments.
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

    /// Returns the simulated time, s.
    pub fn time(&self) -> f64 {
        self.progress.map_or(0.0, |p| p.time) + self.sleep.skipped.1
    }

    /// Returns the kind of solver.
    pub fn kind(&self) -> SolverKind {
        self.simulator.integrator()
    }

    /// Returns the progress as of the last [`Motion::run`].
    pub fn progress(&self) -> Option<StepProgress> {
        self.progress
    }

    /// Reads back energies, volume and displacement.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn report(&self) -> Result<Report> {
        self.simulator.report()
    }
}
