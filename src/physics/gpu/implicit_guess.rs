//! The start of an implicit step of finite elements, and the matrix blocks there; the CPU side of
//! `shaders/physics/implicit_euler_guess.wgsl` and `implicit_euler_start.wgsl`.
//!
//! A step is one Newton iteration on the incremental potential, so its error depends mainly on
//! its start: the extrapolation x + h (2v − v₋₁), two orders more accurate than x, is used if it
//! has the lowest potential.

use super::contact::GpuContact;
use super::elements::GpuElements;
use super::implicit_rigid::{RigidContext, RigidPasses};
use super::step_resources::StepResources;
use crate::Result;
use crate::gpu::{Array, Pass, Texel};
use crate::physics::GpuBody;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/implicit_euler_guess.wgsl`.
        pub struct GuessParams {
            pub gravity: [f32; 4],
            pub nodes: u32,
            pub tets: u32,
            pub dt: f32,
            pub drag: f32,
            pub newton: f32,
            pub _pad0: u32,
            pub _pad1: u32,
            pub _pad2: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/implicit_euler_start.wgsl`.
        pub struct StartParams {
            pub nodes: u32,
            pub groups: u32,
            pub dt: f32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/gpu/scale.wgsl`.
        pub struct Scale {
            pub items: u32,
            pub factor: f32,
        }
    }
}
use gpu_data::{GuessParams, Scale, StartParams};

/// The rigid bodies in a step.
pub(in crate::physics) type RigidContextRef<'a> = (&'a RigidPasses, RigidContext<'a>);

/// The start of a step, and the Hessian data of the tets there.
#[derive(Debug)]
pub(in crate::physics) struct InitialState {
    pub positions: Array,
    pub velocities: Array,
    /// The velocities at the start of the previous step.
    pub previous_velocities: Array,
    curvatures: Array,
    partials: wgpu::Buffer,
}

impl InitialState {
    /// Creates the arrays for a body of `elements`.
    pub fn new(core: &StepResources, elements: &GpuElements) -> Result<InitialState> {
        let gpu = &core.gpu;
        let vector = |label| gpu.array_with_headroom(label, Texel::F32x4, core.nodes as usize);
        let curvatures = elements.curvature_texels();
        Ok(InitialState {
            positions: vector("start positions")?,
            velocities: vector("start velocities")?,
            previous_velocities: vector("previous velocities")?,
            curvatures: gpu.array("curvatures", Texel::F32x4, curvatures)?,
            partials: gpu.buffer("partial potentials", u64::from(core.groups) * 16)?,
        })
    }

    /// Passes that select the start of a step and write the matrix blocks there to `matrix`;
    /// afterwards the forces there are in `core.forces`.
    pub fn passes(
        &self,
        core: &StepResources,
        body: &GpuBody,
        elements: &GpuElements,
        (matrix, dt, rigid): (&Array, f32, Option<RigidContextRef<'_>>),
    ) -> Result<Vec<Pass>> {
        let mut passes = Vec::new();
        if let Some((steps, parts)) = rigid {
            passes.push(steps.start(&parts, &self.previous_velocities)?);
        }
        passes.extend(self.select_passes(core, body, elements, (dt, rigid))?);
        passes.extend(self.blocks(core, elements, &self.positions, (matrix, dt, None))?);
        passes.extend(core.force_passes(body, &self.positions, &self.velocities, false)?);
        Ok(passes)
    }

    /// Passes that select the start of a step.
    pub fn select_passes(
        &self,
        core: &StepResources,
        body: &GpuBody,
        elements: &GpuElements,
        with: (f32, Option<RigidContextRef<'_>>),
    ) -> Result<[Pass; 2]> {
        let guess = self.evaluate_pass(core, body, elements, with)?;
        Ok([guess, self.select_pass(core, body, with.0, with.1)?])
    }

    /// Passes that write the matrix blocks at `positions` to `matrix`.
    pub fn blocks(
        &self,
        core: &StepResources,
        elements: &GpuElements,
        positions: &Array,
        with: (&Array, f32, Option<&GpuContact>),
    ) -> Result<[Pass; 2]> {
        let (gpu, status) = (&core.gpu, &core.status);
        Ok([
            elements.curvature_pass(gpu, positions, status, &self.curvatures)?,
            elements.block_pass(gpu, &self.curvatures, status, with)?,
        ])
    }

    fn evaluate_pass(
        &self,
        core: &StepResources,
        body: &GpuBody,
        elements: &GpuElements,
        (dt, rigid): (f32, Option<RigidContextRef<'_>>),
    ) -> Result<Pass> {
        let units = &body.units;
        let gravity = (body.gravity() / units.acceleration()).as_vec3();
        let params = GuessParams {
            gravity: gravity.extend(0.0).to_array(),
            nodes: core.nodes,
            tets: elements.count(),
            dt,
            drag: dt * elements.mass_damping(),
            newton: (1.0 / units.force()) as f32,
            _pad0: 0,
            _pad1: 0,
            _pad2: 0,
        };
        let law = elements.law();
        let first = match rigid {
            Some(_) => format!("{law} rigid"),
            None => law.to_owned(),
        };
        let name = body.named("physics/implicit_euler_guess", &first);
        let pass = core
            .gpu
            .pass(&name)
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(body.nodes().array())
            .read(&body.velocities)
            .read(&self.previous_velocities)
            .read(&body.masses)
            .read(&body.external)
            .read(&core.status)
            .write(&self.partials)
            .params(&params);
        let pass = elements.bind_law(pass);
        let pass = match &rigid {
            Some((steps, parts)) => steps.bind_starts(parts.rigid, pass),
            None => pass,
        };
        match &body.node_terms {
            Some(numbers) => pass.read(numbers),
            None => pass,
        }
        .dispatch_items(core.groups * core.workgroup)
    }

    fn select_pass(
        &self,
        core: &StepResources,
        body: &GpuBody,
        dt: f32,
        rigid: Option<RigidContextRef<'_>>,
    ) -> Result<Pass> {
        let params = StartParams {
            nodes: core.nodes,
            groups: core.groups,
            dt,
            _pad0: 0,
        };
        let name = match rigid {
            Some(_) => "physics/implicit_euler_start rigid",
            None => "physics/implicit_euler_start",
        };
        let pass = core
            .gpu
            .pass(name)
            .constant("WORKGROUP", f64::from(core.workgroup))
            .read(body.nodes().array())
            .read(&body.velocities)
            .read(&self.previous_velocities)
            .read(&body.masses)
            .read(&self.partials)
            .read(&core.status)
            .write(&self.positions)
            .write(&self.velocities)
            .params(&params);
        match &rigid {
            Some((steps, parts)) => steps
                .bind_starts(parts.rigid, pass)
                .write(steps.start_index()),
            None => pass,
        }
        .dispatch_items(core.groups * core.workgroup)
    }

    /// Saves the velocities for the next step, before they change.
    pub fn save_velocities(&self, core: &StepResources, body: &GpuBody) -> Result<Pass> {
        core.gpu
            .pass("gpu/scale")
            .read(&body.velocities)
            .write(&self.previous_velocities)
            .params(&Scale {
                items: core.nodes,
                factor: 1.0,
            })
            .dispatch_items(core.nodes)
    }
}
