//! Implicit Euler after Baraff & Witkin on the GPU; `shaders/physics/implicit_euler*.wgsl`, with
//! the reference `physics::plain::steppers::implicit_euler`.
//!
//! A step assembles the system (one pass), runs conjugate gradients (two passes per iteration; the
//! partial sums of each half are added up at the start of the next), and moves the nodes.
//! Iterations are dispatched indirectly: a gate before every eight of them sets their workgroups to
//! zero once the solve has converged. A solve that needs more iterations than were recorded for its
//! step continues in those recorded next.

use super::implicit_contact::{ContactContext, ContactPasses, LinearSolveContext};
use super::implicit_guess::{InitialState, RigidContextRef};
use super::implicit_rigid::{self, RigidContext, RigidPasses};
use super::integrator::{Integrator, Stage, Step, StepResources, Timing};
use super::stepper::Stepper;
use super::terms::ProgramPart;
use crate::gpu::{Array, Gpu, Pass, Texel};
use crate::physics::CgSettings;
use crate::physics::{GpuBody, SolverKind};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/implicit_euler_begin.wgsl`.
        pub struct BeginParams {
            pub nodes: u32,
            pub dt: f32,
            pub drag: f32,
            pub right: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/lib/cg.wgsl`.
        pub struct CgParams {
            pub nodes: u32,
            pub groups: u32,
            pub max_iterations: u32,
            pub tolerance: f32,
            pub acceptable: f32,
            pub negligible: f32,
            pub drag: f32,
            pub rigid_groups: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/lib/cg.wgsl`.
        pub struct CgScalars {
            pub rz: f32,
            pub rz_start: f32,
            pub rz_floor: f32,
            pub iterations: u32,
            pub done: u32,
            pub _pad0: u32,
            pub _pad1: u32,
            pub _pad2: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/implicit_euler_gate.wgsl`.
        pub struct GateParams {
            pub groups: u32,
            pub max_iterations: u32,
            pub rigid_groups: u32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/implicit_euler.wgsl`.
        pub struct AdvanceParams {
            pub nodes: u32,
            pub dt: f32,
        }
    }
}
use gpu_data::{AdvanceParams, BeginParams, CgParams, CgScalars, GateParams};

/// Motion per step, over the body's extent, below the resolution of f32 positions.
const MIN_VISIBLE_MOVE: f32 = 1e-9;

/// Stopping criteria of conjugate gradients. Residuals are relative: √(rᵀD⁻¹r / bᵀD⁻¹b), D the
/// diagonal blocks.
///
/// With the default tolerance 10⁻³ the error of an oscillating bar (`benches/steps.rs`) after 60
/// steps is 1.5 · 10⁻⁵ of its path; with 10⁻² it is 2 · 10⁻⁴, for two thirds of the iterations.
#[derive(Debug)]
pub struct ImplicitEulerScheme {
    settings: CgSettings,
    /// The terms' data of the system matrix.
    matrix: Array,
    /// Start selection for finite elements.
    start: Option<InitialState>,
    /// Rigid bodies, if any.
    rigid: Option<RigidPasses>,
    /// Tool contact, if any.
    contact: Option<ContactPasses>,
    /// Two texels per node; two more if the body has terms besides the springs.
    preconditioner: Array,
    pub(in crate::physics) product: Array,
    solution: [Array; 2],
    residual: [Array; 2],
    pub(in crate::physics) preconditioned: [Array; 2],
    direction: [Array; 2],
    scalars: [wgpu::Buffer; 2],
    arguments: wgpu::Buffer,
    rz_partials: wgpu::Buffer,
    pq_partials: wgpu::Buffer,
}

impl Stepper<ImplicitEulerScheme> {
    /// A solver for `body` with these stopping criteria of conjugate gradients.
    ///
    /// # Errors
    /// [`Error::Input`] if a setting is out of range; otherwise as [`Stepper::new`].
    pub fn with(gpu: &Gpu, body: &GpuBody, settings: CgSettings) -> Result<Self> {
        let CgSettings {
            tolerance,
            acceptable,
            max_iterations,
        } = settings;
        if !(tolerance > 0.0 && tolerance < 1.0 && acceptable >= tolerance && max_iterations > 0) {
            return Err(Error::Input(format!(
                "invalid settings of conjugate gradients: tolerance {tolerance}, acceptable {acceptable}, {max_iterations} iterations; require 0 < tolerance < 1, tolerance ≤ acceptable and at least 1 iteration"
            )));
        }
        let mut stepper = Self::new(gpu, body)?;
        stepper.scheme.settings = settings;
        Ok(stepper)
    }
}

impl Integrator for ImplicitEulerScheme {
    const KIND: SolverKind = SolverKind::Implicit;
    const SUPPORTS_RIGID: bool = true;

    fn new(core: &StepResources, body: &GpuBody) -> Result<ImplicitEulerScheme> {
        let gpu = &core.gpu;
        let nodes = body.node_count();
        let vector = |label| gpu.array_with_headroom(label, Texel::F32x4, nodes);
        let pair = |label| -> Result<[Array; 2]> { Ok([vector(label)?, vector(label)?]) };
        let scalars = || gpu.buffer("cg scalars", size_of::<CgScalars>() as u64);
        let partials = |label| gpu.buffer(label, partials(core, body));
        Ok(ImplicitEulerScheme {
            settings: CgSettings::default(),
            matrix: gpu.array_with_headroom(
                "matrix",
                Texel::F32x4,
                body.material_term().matrix_texels(),
            )?,
            start: match &body.elements {
                Some(elements) => Some(InitialState::new(core, elements)?),
                None => None,
            },
            rigid: rigid_steps(core, body)?,
            contact: contact_steps(core, body)?,
            preconditioner: gpu.array_with_headroom(
                "preconditioner",
                Texel::F32x4,
                blocks(body),
            )?,
            product: vector("product")?,
            solution: pair("solution")?,
            residual: pair("residual")?,
            preconditioned: pair("preconditioned residual")?,
            direction: pair("direction")?,
            scalars: [scalars()?, scalars()?],
            arguments: gpu.buffer("cg workgroups", 24)?,
            rz_partials: partials("partial r·z")?,
            pq_partials: partials("partial p·q")?,
        })
    }

    fn apply_cut(&mut self, core: &StepResources, body: &GpuBody) -> Result<()> {
        let (gpu, nodes) = (&core.gpu, body.node_count());
        gpu.resize(
            &mut self.matrix,
            "matrix",
            body.material_term().matrix_texels(),
        )?;
        if let Some(elements) = &body.elements {
            self.start = Some(InitialState::new(core, elements)?);
        }
        gpu.resize(&mut self.preconditioner, "preconditioner", blocks(body))?;
        gpu.resize(&mut self.product, "product", nodes)?;
        for pair in [
            &mut self.solution,
            &mut self.residual,
            &mut self.preconditioned,
            &mut self.direction,
        ] {
            for vector in pair {
                gpu.resize(vector, "conjugate gradients", nodes)?;
            }
        }
        self.rigid = rigid_steps(core, body)?;
        self.contact = contact_steps(core, body)?;
        let partials = partials(core, body);
        if partials > self.rz_partials.size() {
            self.rz_partials = gpu.buffer("partial r·z", partials)?;
            self.pq_partials = gpu.buffer("partial p·q", partials)?;
        }
        Ok(())
    }

    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step> {
        let params = self.params(core, body, timing);
        let pushed = self.contact_context(core, body, timing);
        let (mut before, mut after_restart, mut keep) = (Vec::new(), None, None);
        let tied = self.rigid_context(core, body, timing);
        if let (Some(start), Some(elements)) = (&self.start, &body.elements) {
            before = match &pushed {
                Some((steps, with)) => {
                    let picked = start.select_passes(core, body, elements, (timing.dt, tied))?;
                    [steps.init_pass(with)?].into_iter().chain(picked).collect()
                }
                None => start.passes(core, body, elements, (&self.matrix, timing.dt, tied))?,
            };
            keep = Some(start.save_velocities(core, body)?);
        }
        let begin = self.assemble_pass(core, body, timing)?;
        let solved = self.solved(rhs_offset(body));
        let mut between = Vec::new();
        match &pushed {
            Some((steps, with)) => {
                before.extend(steps.first_system_passes(with, &solved, &begin)?);
                between = steps.newton_passes(with, &solved, &begin)?;
            }
            None => before.push(begin),
        }
        if let Some(tied) = &tied {
            let (steps, parts) = tied;
            before.push(steps.system(parts, &self.matrix, &self.preconditioner)?);
            before.push(self.precondition(tied, 0, None)?);
        }
        if let Some(keep) = &keep {
            let first = [keep.clone()].into_iter();
            after_restart = Some(Stage::Passes(first.chain(before.iter().cloned()).collect()));
        }
        let gate = core
            .gpu
            .pass("physics/implicit_euler_gate")
            .read(&core.status)
            .read(&self.scalars[0])
            .write(&self.arguments)
            .params(&GateParams {
                groups: core.groups,
                max_iterations: self.settings.max_iterations,
                rigid_groups: params.rigid_groups,
                _pad0: 0,
            })
            .dispatch_items(1)?;
        let mut rounds = Vec::new();
        for from in [0, 1] {
            rounds.push(self.cg_direction_pass(core, body, from, &params)?);
            rounds.push(self.cg_update_pass(core, from, &params)?);
            if let Some(tied) = &tied {
                rounds.push(self.precondition(tied, 1 - from, Some(&self.arguments))?);
            }
        }
        let (mut take_over, mut settle) = (Vec::new(), Vec::new());
        match &pushed {
            // The result of the iterations is the candidate state.
            Some((steps, with)) => settle.push(steps.finish(with)?),
            None => settle.extend(self.finish(core, body, timing, &params)?),
        }
        if let Some((steps, parts)) = &tied {
            take_over = steps.project_to_rigid(parts)?;
            settle.push(steps.advance_pass(parts, &self.solution)?);
        }
        settle.extend(keep);
        Ok(Step {
            on_external_change: take_over,
            stages: vec![
                Stage::Passes(before),
                Stage::Loop {
                    gate,
                    rounds,
                    between,
                },
                Stage::Passes(settle),
                Stage::Forces(None),
            ],
            first_stage_on_restart: after_restart,
            after_change: None,
        })
    }

    fn history_arrays(&self) -> Vec<&Array> {
        self.start
            .iter()
            .map(|start| &start.previous_velocities)
            .collect()
    }

    fn max_iterations(&self) -> u32 {
        self.settings.max_iterations
    }
}

/// Texels of the preconditioner, of the diagonal blocks of node terms, and with tools of the
/// right-hand side.
fn blocks(body: &GpuBody) -> usize {
    let kept = match body.contact {
        Some(_) => body.node_count(),
        None => 0,
    };
    rhs_offset(body) as usize + kept
}

/// The texel after the diagonal blocks, where the right-hand side begins.
fn rhs_offset(body: &GpuBody) -> u32 {
    let of_terms = usize::from(!body.terms().is_empty());
    (2 * body.node_count() * (1 + of_terms)) as u32
}

/// The passes of the rigid bodies of `body`, if it has any.
fn rigid_steps(core: &StepResources, body: &GpuBody) -> Result<Option<RigidPasses>> {
    let rigid = body.rigid.as_ref();
    rigid.map(|rigid| RigidPasses::new(core, rigid)).transpose()
}

/// The passes of the tools on `body`, if there are any.
fn contact_steps(core: &StepResources, body: &GpuBody) -> Result<Option<ContactPasses>> {
    let contact = body.contact.as_ref();
    contact
        .map(|contact| ContactPasses::new(core, contact))
        .transpose()
}

/// Bytes of one partial sum per workgroup: of the passes over nodes, then of those over rigid
/// bodies.
fn partials(core: &StepResources, body: &GpuBody) -> u64 {
    16 * u64::from(core.groups + implicit_rigid::groups(body))
}

/// h α of the damping force −α m v on every node.
fn mass_damping_step(body: &GpuBody, timing: Timing) -> f32 {
    let elements = body.elements.as_ref();
    elements.map_or(0.0, |elements| timing.dt * elements.mass_damping())
}

impl ImplicitEulerScheme {
    /// Positions and velocities at which the system of a step is assembled.
    fn start<'a>(&'a self, core: &'a StepResources, body: &'a GpuBody) -> (&'a Array, &'a Array) {
        match (&self.start, &body.contact) {
            (Some(_), Some(_)) => (&core.next_positions, &core.next_velocities),
            (Some(start), None) => (&start.positions, &start.velocities),
            (None, _) => (body.nodes().array(), &body.velocities),
        }
    }

    /// The context of the tools in a step, if there are any.
    pub(in crate::physics) fn contact_context<'a>(
        &'a self,
        core: &'a StepResources,
        body: &'a GpuBody,
        timing: Timing,
    ) -> Option<(&'a ContactPasses, ContactContext<'a>)> {
        let with = ContactContext {
            core,
            body,
            elements: body.elements.as_ref()?,
            contact: body.contact.as_ref()?,
            start: self.start.as_ref()?,
            dt: timing.dt,
        };
        Some((self.contact.as_ref()?, with))
    }

    fn solved(&self, right: u32) -> LinearSolveContext<'_> {
        LinearSolveContext {
            solution: &self.solution,
            scalars: &self.scalars[0],
            rz_partials: &self.rz_partials,
            matrix: &self.matrix,
            preconditioner: &self.preconditioner,
            right,
            max_iterations: self.settings.max_iterations,
        }
    }

    /// Ends the solve and moves the nodes by its solution.
    fn finish(
        &self,
        core: &StepResources,
        body: &GpuBody,
        timing: Timing,
        params: &CgParams,
    ) -> Result<[Pass; 2]> {
        let (_, start_velocities) = self.start(core, body);
        let finish = core
            .gpu
            .pass("physics/implicit_euler_finish")
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(&self.rz_partials)
            .read(&self.scalars[0])
            .write(&core.status)
            .params(params)
            .dispatch_items(core.workgroup)?;
        let moved = core
            .gpu
            .pass("physics/implicit_euler")
            .read(body.nodes().array())
            .read(start_velocities)
            .read(&body.masses)
            .read(&self.solution[0])
            .read(&self.solution[1])
            .read(&core.status)
            .write(&core.next_positions)
            .write(&core.next_velocities)
            .params(&AdvanceParams {
                nodes: core.nodes,
                dt: timing.dt,
            })
            .dispatch_items(core.nodes)?;
        Ok([finish, moved])
    }

    fn params(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> CgParams {
        let square = |x: f64| (x * x) as f32;
        CgParams {
            nodes: core.nodes,
            groups: core.groups,
            max_iterations: self.settings.max_iterations,
            tolerance: square(self.settings.tolerance),
            acceptable: square(self.settings.acceptable),
            negligible: (MIN_VISIBLE_MOVE / timing.dt).powi(2),
            drag: mass_damping_step(body, timing),
            rigid_groups: implicit_rigid::groups(body),
        }
    }

    /// The context of the rigid bodies in a step, if there are any.
    fn rigid_context<'a>(
        &'a self,
        core: &'a StepResources,
        body: &'a GpuBody,
        timing: Timing,
    ) -> Option<RigidContextRef<'a>> {
        let steps = self.rigid.as_ref()?;
        let parts = RigidContext {
            core,
            body,
            elements: body.elements.as_ref()?,
            rigid: body.rigid.as_ref()?,
            dt: timing.dt,
            drag: mass_damping_step(body, timing),
        };
        Some((steps, parts))
    }

    /// Passes that project and precondition the residual in a slot for rigid bodies, after an
    /// iteration or before the first.
    fn precondition(
        &self,
        (steps, parts): &RigidContextRef<'_>,
        slot: usize,
        arguments: Option<&wgpu::Buffer>,
    ) -> Result<Pass> {
        let vectors = [&self.residual[slot], &self.preconditioned[slot]];
        let scalars = [&self.scalars[1 - slot], &self.scalars[slot]];
        steps.precondition(parts, vectors, scalars, (&self.rz_partials, arguments))
    }

    /// Assembles the system of a step.
    fn assemble_pass(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Pass> {
        let params = BeginParams {
            nodes: core.nodes,
            dt: timing.dt,
            drag: mass_damping_step(body, timing),
            right: rhs_offset(body),
        };
        let (positions, velocities) = self.start(core, body);
        let name = body.shader_name_with_contact("physics/implicit_euler_begin", true);
        let pass = core
            .gpu
            .pass(&name)
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(positions)
            .read(velocities)
            .read(&body.masses)
            .read(&core.forces)
            .read(&core.status)
            .write(&self.preconditioner)
            .write(&self.residual[0])
            .write(&self.preconditioned[0])
            .write(&self.rz_partials)
            .write(&self.scalars[0])
            .params(&params);
        let threads = core.groups * core.workgroup;
        let part = ProgramPart::System {
            matrix: &self.matrix,
            velocities: &body.velocities,
        };
        body.bind_pressed(pass, part, true).dispatch_items(threads)
    }

    /// First half of an iteration, from slot `from` of the vectors to the other.
    fn cg_direction_pass(
        &self,
        core: &StepResources,
        body: &GpuBody,
        from: usize,
        params: &CgParams,
    ) -> Result<Pass> {
        let name = body.shader_name_with_contact("physics/implicit_euler_direction", true);
        let pass = core
            .gpu
            .pass(&name)
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(&self.preconditioned[from])
            .read(&self.direction[from])
            .read(&body.masses)
            .read(&core.status)
            .read(&self.rz_partials)
            .read(&self.scalars[from])
            .write(&self.direction[1 - from])
            .write(&self.product)
            .write(&self.pq_partials)
            .write(&self.scalars[1 - from])
            .params(params);
        let part = ProgramPart::Product {
            matrix: &self.matrix,
            blocks: &self.preconditioner,
        };
        body.bind_pressed(pass, part, true)
            .dispatch_indirect(&self.arguments, 0)
    }

    /// Second half of an iteration.
    fn cg_update_pass(&self, core: &StepResources, from: usize, params: &CgParams) -> Result<Pass> {
        core.gpu
            .pass("physics/implicit_euler_update")
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(&self.direction[1 - from])
            .read(&self.product)
            .read(&self.solution[from])
            .read(&self.residual[from])
            .read(&self.preconditioner)
            .read(&core.status)
            .read(&self.pq_partials)
            .read(&self.scalars[from])
            .read(&self.scalars[1 - from])
            .write(&self.solution[1 - from])
            .write(&self.residual[1 - from])
            .write(&self.preconditioned[1 - from])
            .write(&self.rz_partials)
            .params(params)
            .dispatch_indirect(&self.arguments, 0)
    }
}
