//! Rigid bodies in the implicit steps of finite elements; the CPU side of
//! `shaders/physics/rigid_*.wgsl`.
//!
//! A step starts from poses, projects conjugate gradients onto rigid-body modes, and ends with
//! poses. Its passes are inserted between those of the step without rigid bodies, whose vectors
//! keep one entry per node.

use super::elements::GpuElements;
use super::rigid::GpuRigid;
use super::step_resources::StepResources;
use crate::Result;
use crate::gpu::{Array, Pass, PassBuilder, Texel};
use crate::physics::GpuBody;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/lib/rigid_members.wgsl`.
        pub struct RigidParams {
            pub bodies: u32,
            pub members: u32,
            pub nodes: u32,
            pub groups: u32,
            pub dt: f32,
            pub drag: f32,
            pub terms: u32,
            pub first: u32,
        }
    }
}
use gpu_data::RigidParams;

/// Texels per body in `motions` and `blocks`.
const MOTION_TEXELS: usize = 6;
const BLOCK_TEXELS: usize = 13;

/// Maximum number of workgroups of a pass with one workgroup per body; each loops over several
/// bodies if there are more.
const MAX_WORKGROUPS: u32 = 512;

/// Arrays of rigid bodies in a step.
#[derive(Debug)]
pub(in crate::physics) struct RigidPasses {
    /// Present poses and candidate starts.
    motions: Array,
    /// Inverses of the bodies' diagonal blocks.
    blocks: Array,
    /// The selected start.
    choice: wgpu::Buffer,
}

/// Inputs of the rigid-body passes.
#[derive(Clone, Copy)]
pub(in crate::physics) struct RigidContext<'a> {
    pub core: &'a StepResources,
    pub body: &'a GpuBody,
    pub elements: &'a GpuElements,
    pub rigid: &'a GpuRigid,
    /// Step h and h α, in local units.
    pub dt: f32,
    pub drag: f32,
}

impl RigidContext<'_> {
    fn params(&self) -> RigidParams {
        RigidParams {
            bodies: self.rigid.count(),
            members: self.rigid.node_count(),
            nodes: self.core.nodes,
            groups: self.core.groups,
            dt: self.dt,
            drag: self.drag,
            terms: u32::from(!self.body.terms().is_empty()),
            first: 0,
        }
    }

    fn pass<'a>(&'a self, name: &'a str) -> PassBuilder<'a> {
        let workgroup = f64::from(self.core.workgroup);
        self.core.gpu.pass(name).constant("WORKGROUP", workgroup)
    }

    fn threads(&self) -> u32 {
        groups(self.body) * self.core.workgroup
    }
}

/// Number of workgroups of passes over the rigid bodies of `body`; 0 if it has none.
pub(in crate::physics) fn groups(body: &GpuBody) -> u32 {
    let rigid = body.rigid.as_ref();
    rigid.map_or(0, |rigid| rigid.count().min(MAX_WORKGROUPS))
}

impl RigidPasses {
    /// Creates the arrays for the bodies `rigid`.
    pub fn new(core: &StepResources, rigid: &GpuRigid) -> Result<RigidPasses> {
        let (gpu, count) = (&core.gpu, rigid.count() as usize);
        let array = |label, texels| gpu.array(label, Texel::F32x4, texels * count);
        Ok(RigidPasses {
            motions: array("rigid motions", MOTION_TEXELS)?,
            blocks: array("rigid blocks", BLOCK_TEXELS)?,
            choice: gpu.buffer("initial guess choice", 4)?,
        })
    }

    /// Binds the candidate starts of the bodies' nodes, for passes composed with `terms/rigid`.
    pub fn bind_starts<'a>(
        &'a self,
        rigid: &'a GpuRigid,
        pass: PassBuilder<'a>,
    ) -> PassBuilder<'a> {
        rigid.bind(pass).read(&self.motions)
    }

    /// The buffer with the index of the selected start.
    pub fn start_index(&self) -> &wgpu::Buffer {
        &self.choice
    }

    /// After an external change of positions or velocities: passes that project the nodes onto
    /// rigid motions.
    pub fn project_to_rigid(&self, parts: &RigidContext) -> Result<Vec<Pass>> {
        let (body, rest, params) = (parts.body, parts.elements.rest(), parts.params());
        let fit = parts
            .pass("physics/rigid_fit")
            .read(body.nodes().array())
            .read(&body.velocities)
            .read(&body.masses)
            .read(rest)
            .write(&self.motions)
            .params(&params);
        let place = parts
            .pass("physics/rigid_place")
            .read(rest)
            .read(&self.motions)
            .write(body.nodes().array())
            .write(&body.velocities)
            .params(&params);
        Ok(vec![
            parts
                .rigid
                .bind_members(fit)
                .dispatch_items(parts.threads())?,
            parts
                .rigid
                .bind_members(place)
                .dispatch_items(params.members)?,
        ])
    }

    /// The pass before a start is selected; `before` are the velocities at the start of the
    /// previous step.
    pub fn start(&self, parts: &RigidContext, before: &Array) -> Result<Pass> {
        let (core, body, params) = (parts.core, parts.body, parts.params());
        let pass = parts
            .pass("physics/rigid_start")
            .read(body.nodes().array())
            .read(&body.velocities)
            .read(before)
            .read(&body.masses)
            .read(parts.elements.rest())
            .read(&core.status)
            .write(&self.motions)
            .params(&params);
        parts
            .rigid
            .bind_members(pass)
            .dispatch_items(parts.threads())
    }

    /// After the system is assembled: passes that compute the bodies' own blocks.
    pub fn system(
        &self,
        parts: &RigidContext,
        matrix: &Array,
        preconditioner: &Array,
    ) -> Result<Pass> {
        let (rows, columns, _) = parts.elements.edges();
        let params = parts.params();
        let pass = parts
            .pass("physics/rigid_blocks")
            .read(&parts.body.masses)
            .read(&self.motions)
            .read(rows)
            .read(columns)
            .read(matrix)
            .read(preconditioner)
            .read(&self.choice)
            .read(&parts.core.status)
            .write(&self.blocks)
            .params(&params);
        parts
            .rigid
            .bind_members(pass)
            .dispatch_items(parts.threads())
    }

    /// Preconditions the residual; both are in `vectors`. Dispatched before the iterations, or
    /// after each with the workgroup count in `arguments`. `scalars` are those before and after it.
    pub fn precondition(
        &self,
        parts: &RigidContext,
        [residual, preconditioned]: [&Array; 2],
        [before, after]: [&wgpu::Buffer; 2],
        (partials, arguments): (&wgpu::Buffer, Option<&wgpu::Buffer>),
    ) -> Result<Pass> {
        let params = RigidParams {
            first: u32::from(arguments.is_none()),
            ..parts.params()
        };
        let pass = parts
            .pass("physics/rigid_precondition")
            .read(residual)
            .read(&self.blocks)
            .read(&parts.core.status)
            .read(before)
            .read(after)
            .write(preconditioned)
            .write(partials)
            .params(&params);
        let pass = parts.rigid.bind_members(pass);
        match arguments {
            // Offset past the three words of the passes over all nodes.
            Some(arguments) => pass.dispatch_indirect(arguments, 12),
            None => pass.dispatch_items(parts.threads()),
        }
    }

    /// After the solve, whose solution is in one of the two arrays: writes the candidate state at
    /// the bodies' nodes.
    pub fn advance_pass(&self, parts: &RigidContext, solution: &[Array; 2]) -> Result<Pass> {
        let (core, body, params) = (parts.core, parts.body, parts.params());
        let pass = parts
            .pass("physics/rigid_move")
            .read(body.nodes().array())
            .read(parts.elements.rest())
            .read(&body.masses)
            .read(&self.motions)
            .read(&solution[0])
            .read(&solution[1])
            .read(&self.choice)
            .read(&core.status)
            .write(&core.next_positions)
            .write(&core.next_velocities)
            .params(&params);
        parts
            .rigid
            .bind_members(pass)
            .dispatch_items(parts.threads())
    }
}
