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
use super::implicit_passes::{CgScalars, mass_damping_step, rhs_offset};
use super::implicit_rigid::{self, RigidContext, RigidPasses};
use super::integrator::{Integrator, Stage, Step, StepResources, Timing};
use super::stepper::Stepper;
use crate::gpu::{Array, Gpu, Texel};
use crate::physics::{CgSettings, GpuBody, SolverKind};
use crate::{Error, Result};

/// Implicit Euler with conjugate gradients, whose residuals are relative: √(rᵀD⁻¹r / bᵀD⁻¹b), D the
/// diagonal blocks.
///
/// With the default tolerance 10⁻³ the error of an oscillating bar (`benches/steps.rs`) after 60
/// steps is 1.5 · 10⁻⁵ of its path; with 10⁻² it is 2 · 10⁻⁴, for two thirds of the iterations.
#[derive(Debug)]
pub struct ImplicitEulerScheme {
    pub(super) settings: CgSettings,
    /// The terms' data of the system matrix.
    pub(super) matrix: Array,
    /// Start selection for finite elements.
    pub(super) start: Option<InitialState>,
    /// Rigid bodies, if any.
    pub(super) rigid: Option<RigidPasses>,
    /// Tool contact, if any.
    pub(super) contact: Option<ContactPasses>,
    /// Two texels per node; two more if the body has terms besides the springs.
    pub(super) preconditioner: Array,
    pub(in crate::physics) product: Array,
    pub(super) solution: [Array; 2],
    pub(super) residual: [Array; 2],
    pub(in crate::physics) preconditioned: [Array; 2],
    pub(super) direction: [Array; 2],
    pub(super) scalars: [wgpu::Buffer; 2],
    pub(super) arguments: wgpu::Buffer,
    pub(super) rz_partials: wgpu::Buffer,
    pub(super) pq_partials: wgpu::Buffer,
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
            start: match body.elements() {
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
        if let Some(elements) = body.elements() {
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
        if let (Some(start), Some(elements)) = (&self.start, body.elements()) {
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
        let gate = self.gate_pass(core, &params)?;
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

impl ImplicitEulerScheme {
    /// Positions and velocities at which the system of a step is assembled.
    pub(super) fn start<'a>(
        &'a self,
        core: &'a StepResources,
        body: &'a GpuBody,
    ) -> (&'a Array, &'a Array) {
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
            elements: body.elements()?,
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
            elements: body.elements()?,
            rigid: body.rigid.as_ref()?,
            dt: timing.dt,
            drag: mass_damping_step(body, timing),
        };
        Some((steps, parts))
    }
}
