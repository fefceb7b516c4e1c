//! The passes of implicit Euler: the system, conjugate gradients, and the step by their solution.

use super::implicit_euler::ImplicitEulerScheme;
use super::implicit_guess::RigidContextRef;
use super::implicit_rigid;
use super::integrator::{StepResources, Timing};
use super::terms::ProgramPart;
use crate::Result;
use crate::gpu::Pass;
use crate::physics::GpuBody;

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
use gpu_data::{AdvanceParams, BeginParams, GateParams};
pub(super) use gpu_data::{CgParams, CgScalars};

/// Motion per step, over the body's extent, below the resolution of f32 positions.
const MIN_VISIBLE_MOVE: f32 = 1e-9;

/// The texel after the diagonal blocks, where the right-hand side begins.
pub(super) fn rhs_offset(body: &GpuBody) -> u32 {
    let of_terms = usize::from(!body.terms().is_empty());
    (2 * body.node_count() * (1 + of_terms)) as u32
}

/// h α of the damping force −α m v on every node.
pub(super) fn mass_damping_step(body: &GpuBody, timing: Timing) -> f32 {
    let elements = body.elements();
    elements.map_or(0.0, |elements| timing.dt * elements.mass_damping())
}

impl ImplicitEulerScheme {
    /// Ends the solve and moves the nodes by its solution.
    pub(super) fn finish(
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

    /// The parameters of conjugate gradients in a step.
    pub(super) fn params(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> CgParams {
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

    /// Sets the workgroups of the next iterations, 0 once the solve has converged.
    pub(super) fn gate_pass(&self, core: &StepResources, params: &CgParams) -> Result<Pass> {
        core.gpu
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
            .dispatch_items(1)
    }

    /// Passes that project and precondition the residual in a slot for rigid bodies, after an
    /// iteration or before the first.
    pub(super) fn precondition(
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
    pub(super) fn assemble_pass(
        &self,
        core: &StepResources,
        body: &GpuBody,
        timing: Timing,
    ) -> Result<Pass> {
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
    pub(super) fn cg_direction_pass(
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
    pub(super) fn cg_update_pass(
        &self,
        core: &StepResources,
        from: usize,
        params: &CgParams,
    ) -> Result<Pass> {
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
