//! The chain of passes that every solver's step is: propose, weigh, check, commit.

use super::body::Revision;
use super::guard::gpu_data::Status;
use super::guard::{Clock, ENERGY_FACTOR, ENERGY_FLOOR, HISTORY, Progress, StepRecord};
use super::{Body, Damping, Solver, SolverKind};
use crate::gpu::{Array, Gpu, Pass, Recorder, Texel};
use crate::{Error, Result};
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/spring_forces.wgsl`.
        pub struct ForceParams {
            pub gravity: [f32; 4],
            pub nodes: u32,
            pub damping: f32,
            pub damping_time: f32,
            pub axial: u32,
            pub newton: f32,
            pub _pad0: u32,
            pub _pad1: u32,
            pub _pad2: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/check.wgsl`.
        pub struct CheckParams {
            pub kind: u32,
            pub groups: u32,
            pub history: u32,
            pub dt: f32,
            pub floor: f32,
            pub factor: f32,
        }
    }
}
use gpu_data::{CheckParams, ForceParams};

/// Spring visits in one submit: well below a second on the weakest GPU.
const VISITS: f64 = 5e8;

/// Iterations of a linear solve recorded a step by [`Solver::record`].
const RECORDED_ITERATIONS: u32 = 256;

/// Dispatches in one submit.
const DISPATCHES: u32 = 8192;

/// Pairs of iterations behind one gate.
const GATED: u32 = 4;

/// What all solvers have: the candidate state, the forces, and the guard.
#[derive(Debug)]
pub struct Core {
    pub(super) gpu: Gpu,
    pub(super) nodes: u32,
    /// Threads a workgroup, and workgroups, of passes that sum over the nodes.
    pub(super) workgroup: u32,
    pub(super) groups: u32,
    pub(super) next_positions: Array,
    pub(super) next_velocities: Array,
    pub(super) forces: Array,
    pub(super) partials: wgpu::Buffer,
    pub(super) status: wgpu::Buffer,
    history: wgpu::Buffer,
    body: u64,
    /// Of the body, when the arrays were made for it.
    generation: u64,
    texels: u32,
}

/// The passes of one step, between the forces at its start and the check at its end.
#[derive(Debug, Default)]
pub struct StepPasses {
    /// Everything before the iterations.
    pub(super) before: Vec<Pass>,
    /// In place of it in the first step after a restart, where that differs.
    pub(super) after_restart: Option<Vec<Pass>>,
    /// In place of it in the first step after a change of dt, where that differs.
    pub(super) after_change: Option<Vec<Pass>>,
    /// Before every [`GATED`] pairs of iterations.
    pub(super) gate: Option<Pass>,
    /// Two iterations of a linear solve.
    pub(super) iterations: Vec<Pass>,
    /// Everything after them, up to the candidate state.
    pub(super) settle: Vec<Pass>,
    /// The velocities that the candidate's forces see, where not the candidate's.
    pub(super) velocities: Option<Array>,
    /// After the candidate's forces.
    pub(super) after: Vec<Pass>,
}

/// The length of a step, in local units.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// This step's.
    pub(super) dt: f32,
    /// The step before's.
    pub(super) before: f32,
}

/// What tells one solver from another.
pub trait Scheme: Sized {
    /// Its name.
    const KIND: SolverKind;

    /// What it keeps on the GPU.
    ///
    /// # Errors
    /// What the device refuses.
    fn new(core: &Core, body: &Body) -> Result<Self>;

    /// Makes what it keeps as long as a cut has made the body; the steps that follow start
    /// afresh.
    ///
    /// # Errors
    /// What the device refuses.
    fn follow(&mut self, core: &Core, body: &Body) -> Result<()> {
        *self = Self::new(core, body)?;
        Ok(())
    }

    /// The passes of its step.
    ///
    /// # Errors
    /// What the device refuses.
    fn passes(&self, core: &Core, body: &Body, timing: Timing) -> Result<StepPasses>;

    /// Iterations of its linear solve at most, 0 where it has none.
    fn max_iterations(&self) -> u32 {
        0
    }
}

/// A solver: the chain of passes around a scheme, bound to one body. See [`Solver`].
#[derive(Debug)]
pub struct Stepper<S> {
    pub(super) core: Core,
    pub(super) scheme: S,
    prepared: Option<Prepared>,
    clock: Clock,
    /// Iterations that [`Solver::run`] records a step.
    iterations: u32,
    /// Whether steps were recorded since the status was last read.
    unseen: bool,
}

/// Passes ready to be recorded, and what they were made for.
#[derive(Debug)]
struct Prepared {
    dt: f64,
    local_dt: f32,
    gravity: DVec3,
    /// The body as it was last left or found.
    revision: Revision,
    step: StepPasses,
    /// The grabs' lists that `draw` was made for.
    grabs: u64,
    /// What grabs by springs pull with at the candidate's positions.
    draw: Option<Pass>,
    forces: Pass,
    check: Pass,
    commit: Pass,
    /// Clears a failure.
    forgive: Pass,
    /// Before the first step on a state that was changed from outside: everything from it.
    restart: [Pass; 2],
    /// Before the first step of any other recording: external forces may have changed.
    resume: [Pass; 2],
}

/// How the steps of a recording begin.
#[derive(Clone, Copy, PartialEq)]
enum Start {
    Restart,
    Change,
    Resume,
}

impl<S: Scheme> Stepper<S> {
    /// A solver for `body`.
    ///
    /// # Errors
    /// [`Error::Gpu`] when its arrays do not fit the device.
    pub fn new(gpu: &Gpu, body: &Body) -> Result<Stepper<S>> {
        let core = Core::new(gpu, body)?;
        let scheme = S::new(&core, body)?;
        Ok(Stepper {
            iterations: scheme.max_iterations().min(64),
            core,
            scheme,
            prepared: None,
            clock: Clock::default(),
            unseen: false,
        })
    }

    /// Makes the passes anew where anything they depend on has changed, and records what comes
    /// before the first step.
    fn begin(
        &mut self,
        work: &mut Recorder,
        body: &mut Body,
        dt: f64,
    ) -> Result<(&Prepared, Start)> {
        let local_dt = (dt / body.units.time) as f32;
        if !(dt > 0.0 && dt.is_finite() && local_dt.is_normal()) {
            return Err(Error::Input(format!(
                "a time step of {dt} s makes no sense for this body; give a positive number of seconds"
            )));
        }
        if body.id != self.core.body {
            return Err(Error::Input(
                "a solver steps the body it was made for; make one for each body".into(),
            ));
        }
        body.flush()?;
        if body.generation != self.core.generation {
            self.prepared = None;
            self.core.follow(body)?;
            self.scheme.follow(&self.core, body)?;
        }
        let (revision, gravity) = (body.revision(), body.gravity());
        let known = self.prepared.take();
        let mut start = match &known {
            Some(known) if known.revision.state == revision.state => Start::Resume,
            _ => Start::Restart,
        };
        // Any change may have mended what failed.
        let forgive = known.as_ref().is_none_or(|k| k.revision != revision);
        let mut prepared = match known {
            Some(known) if known.dt == dt && known.gravity == gravity => known,
            known => {
                if start == Start::Resume {
                    start = Start::Change;
                }
                let timing = Timing {
                    dt: local_dt,
                    before: known.map_or(local_dt, |p| p.local_dt),
                };
                let step = self.scheme.passes(&self.core, body, timing)?;
                self.core.prepare(body, step, dt, local_dt)?
            }
        };
        prepared.revision = revision;
        if prepared.grabs != body.grabs.version() {
            prepared.grabs = body.grabs.version();
            let candidate = &self.core.next_positions;
            prepared.draw = body.grabs.draw_pass(candidate, &body.external)?;
        }
        let state = body.nodes().array();
        if let Some(hold) = body.grabs.hold_pass(state)? {
            hold.record(work);
        }
        if let Some(draw) = body.grabs.draw_pass(state, &body.external)? {
            draw.record(work);
        }
        if forgive {
            prepared.forgive.record(work);
        }
        let first: &[Pass] = match start {
            Start::Restart => &prepared.restart,
            _ => &prepared.resume,
        };
        for pass in first {
            pass.record(work);
        }
        Ok((self.prepared.insert(prepared), start))
    }

    pub(super) fn record_steps(
        &mut self,
        work: &mut Recorder,
        body: &mut Body,
        steps: u32,
        dt: f64,
        iterations: u32,
    ) -> Result<()> {
        if steps == 0 {
            return Ok(());
        }
        let (prepared, start) = self.begin(work, body, dt)?;
        let passes = &prepared.step;
        let first = match start {
            Start::Restart => &passes.after_restart,
            Start::Change => &passes.after_change,
            Start::Resume => &None,
        };
        for step in 0..steps {
            let first = first.as_ref().filter(|_| step == 0);
            for pass in first.unwrap_or(&passes.before) {
                pass.record(work);
            }
            for pair in 0..iterations.div_ceil(2) {
                if let Some(gate) = prepared.step.gate.as_ref().filter(|_| pair % GATED == 0) {
                    gate.record(work);
                }
                for pass in &prepared.step.iterations {
                    pass.record(work);
                }
            }
            for pass in &prepared.step.settle {
                pass.record(work);
            }
            if let Some(draw) = &prepared.draw {
                draw.record(work);
            }
            prepared.forces.record(work);
            for pass in &prepared.step.after {
                pass.record(work);
            }
            prepared.check.record(work);
            prepared.commit.record(work);
        }
        self.clock.record(steps, dt);
        self.unseen = true;
        body.mark_moved();
        Ok(())
    }

    /// Steps that fit one submit.
    fn chunk(&self, iterations: u32) -> u32 {
        let passes = 10 + 2 * iterations;
        let visits = 4.0 * f64::from(self.core.texels) * f64::from(3 + iterations);
        let by_visits = (VISITS / visits) as u32;
        by_visits.min(DISPATCHES / passes).clamp(1, HISTORY)
    }

    /// Waits, and reads what the GPU noted.
    fn look(&mut self) -> Result<Status> {
        let noted: Vec<Status> = self.core.gpu.read_buffer(&self.core.status)?;
        let status = noted
            .first()
            .ok_or_else(|| Error::Gpu("the status of the simulation is empty".into()))?;
        self.clock.complete(status.steps);
        self.unseen = false;
        Ok(*status)
    }

    /// Records fewer iterations where the latest step needed fewer, more where they ran out.
    fn adapt(&mut self, needed: u32, completed: bool) {
        let most = self.scheme.max_iterations();
        if most > 0 {
            let wanted = if completed {
                needed + needed / 4 + 4
            } else {
                2 * self.iterations
            };
            self.iterations = wanted.clamp(1, most);
        }
    }
}

impl<S: Scheme> Solver for Stepper<S> {
    fn kind(&self) -> SolverKind {
        S::KIND
    }

    fn record(&mut self, work: &mut Recorder, body: &mut Body, steps: u32, dt: f64) -> Result<()> {
        let iterations = self.scheme.max_iterations().min(RECORDED_ITERATIONS);
        self.record_steps(work, body, steps, dt, iterations)
    }

    fn run(&mut self, body: &mut Body, steps: u32, dt: f64) -> Result<Progress> {
        let mut progress = None;
        if self.unseen {
            self.look()?;
        }
        let end = self.clock.steps() + u64::from(steps);
        while self.clock.steps() < end {
            let before = self.clock.steps();
            let left = (end - before).min(u64::from(HISTORY)) as u32;
            let chunk = left.min(self.chunk(self.iterations));
            let mut work = self.core.gpu.record();
            self.record_steps(&mut work, body, chunk, dt, self.iterations)?;
            work.submit()?;
            let reached = self.poll(body)?;
            self.clock.settle();
            let completed = reached.steps == before + u64::from(chunk);
            self.adapt(reached.last.iterations, completed);
            progress = Some(reached);
        }
        progress.map_or_else(|| self.poll(body), Ok)
    }

    fn poll(&mut self, body: &Body) -> Result<Progress> {
        let status = self.look()?;
        match status.error(S::KIND, &self.clock, body) {
            None => Ok(status.progress(&self.clock, &body.units)),
            Some(error) => {
                self.clock.settle();
                Err(error)
            }
        }
    }

    fn history(&self, body: &Body) -> Result<Vec<StepRecord>> {
        let status: Vec<Status> = self.core.gpu.read_buffer(&self.core.status)?;
        let noted: Vec<[f32; 4]> = self.core.gpu.read_buffer(&self.core.history)?;
        let steps = status.first().map_or(0, |s| s.steps);
        Ok((steps.saturating_sub(HISTORY)..steps)
            .map(|s| StepRecord::of_gpu(noted[(s % HISTORY) as usize], &body.units))
            .collect())
    }
}

/// Threads a workgroup, and workgroups, of passes that sum over `nodes`.
fn workgroups(gpu: &Gpu, nodes: usize) -> (u32, u32) {
    // On a software adapter a workgroup costs microseconds: a few a core. A GPU wants many.
    let cores = std::thread::available_parallelism().map_or(4, usize::from) as u32;
    let (workgroup, most) = match gpu.adapter().device_type {
        wgpu::DeviceType::Cpu => (64, (4 * cores).min(256)),
        _ => (256, 512),
    };
    let groups = (nodes as u32).div_ceil(workgroup).clamp(1, most);
    (workgroup, groups)
}

impl Core {
    fn new(gpu: &Gpu, body: &Body) -> Result<Core> {
        let nodes = body.node_count();
        let (workgroup, groups) = workgroups(gpu, nodes);
        let array = |label| gpu.roomy_array(label, Texel::F32x4, nodes);
        Ok(Core {
            gpu: gpu.clone(),
            nodes: nodes as u32,
            workgroup,
            groups,
            next_positions: array("next positions")?,
            next_velocities: array("next velocities")?,
            forces: array("forces")?,
            partials: gpu.buffer("partial energies", u64::from(groups) * 16)?,
            status: gpu.buffer("status", size_of::<Status>() as u64)?,
            history: gpu.buffer("history", u64::from(HISTORY) * 16)?,
            body: body.id,
            generation: body.generation,
            texels: body.columns.len(),
        })
    }

    /// Makes its arrays as long as a cut has made the body; the count of steps goes on.
    fn follow(&mut self, body: &Body) -> Result<()> {
        let (gpu, nodes) = (self.gpu.clone(), body.node_count());
        gpu.resize(&mut self.next_positions, "next positions", nodes)?;
        gpu.resize(&mut self.next_velocities, "next velocities", nodes)?;
        gpu.resize(&mut self.forces, "forces", nodes)?;
        let (_, groups) = workgroups(&gpu, nodes);
        if groups > self.groups {
            self.partials = gpu.buffer("partial energies", u64::from(groups) * 16)?;
        }
        self.groups = groups;
        self.nodes = nodes as u32;
        self.generation = body.generation;
        self.texels = body.columns.len();
        Ok(())
    }

    fn prepare(&self, body: &Body, step: StepPasses, dt: f64, local_dt: f32) -> Result<Prepared> {
        let velocities = step.velocities.as_ref().unwrap_or(&self.next_velocities);
        let state = body.nodes().array();
        Ok(Prepared {
            dt,
            local_dt,
            gravity: body.gravity(),
            revision: body.revision(),
            grabs: 0,
            draw: None,
            forces: self.force_pass(body, &self.next_positions, velocities)?,
            check: self.check_pass(0, local_dt)?,
            commit: self
                .gpu
                .pass("physics/commit")
                .read(&self.next_positions)
                .read(&self.next_velocities)
                .read(&self.status)
                .write(state)
                .write(&body.velocities)
                .over(self.nodes)?,
            forgive: self
                .gpu
                .pass("physics/restart")
                .write(&self.status)
                .over(1)?,
            restart: [
                self.force_pass(body, state, &body.velocities)?,
                self.check_pass(2, local_dt)?,
            ],
            resume: [
                self.force_pass(
                    body,
                    state,
                    step.velocities.as_ref().unwrap_or(&body.velocities),
                )?,
                self.check_pass(1, local_dt)?,
            ],
            step,
        })
    }

    pub(super) fn force_pass(
        &self,
        body: &Body,
        positions: &Array,
        velocities: &Array,
    ) -> Result<Pass> {
        let units = &body.units;
        let gravity = (body.gravity() / units.acceleration()).as_vec3();
        let params = ForceParams {
            gravity: gravity.extend(0.0).to_array(),
            nodes: self.nodes,
            damping: (body.network.damping / units.damping()) as f32,
            damping_time: (body.network.damping_time / units.time) as f32,
            axial: u32::from(body.network.damping_kind == Damping::Axial),
            newton: (1.0 / units.force()) as f32,
            _pad0: 0,
            _pad1: 0,
            _pad2: 0,
        };
        self.gpu
            .pass("physics/spring_forces")
            .constant("WORKGROUP", f64::from(self.workgroup))
            .read(positions)
            .read(velocities)
            .read(&body.masses)
            .read(&body.external)
            .read(&body.rows)
            .read(&body.columns)
            .read(&body.springs)
            .read(&self.status)
            .write(&self.forces)
            .write(&self.partials)
            .params(&params)
            .over(self.groups * self.workgroup)
    }

    /// `kind` as in `shaders/physics/check.wgsl`.
    fn check_pass(&self, kind: u32, local_dt: f32) -> Result<Pass> {
        let params = CheckParams {
            kind,
            groups: self.groups,
            history: HISTORY,
            dt: local_dt,
            floor: (ENERGY_FLOOR * f64::from(self.nodes)) as f32,
            factor: ENERGY_FACTOR as f32,
        };
        self.gpu
            .pass("physics/check")
            .constant("WORKGROUP", f64::from(self.workgroup))
            .read(&self.partials)
            .write(&self.status)
            .write(&self.history)
            .params(&params)
            .over(self.workgroup)
    }
}
