//! Tool contact in the implicit steps of finite elements; the CPU side of
//! `shaders/physics/contact_*.wgsl`.
//!
//! A step without tools is one Newton iteration; with tools it takes as many as needed. After every
//! few conjugate gradient iterations come passes that do nothing until the solve is done, then
//! perform the line search (accept or shorten the direction) and assemble the next system there.
//! Steps thus consume as many of the recorded passes as they need, and continue in those recorded
//! next.
//!
//! Tools move in stages. Points in contact follow a tool to its next stage as if the barrier were a
//! two-sided spring, for one iteration; after that the actual barrier applies.

use super::contact::{GpuContact, NODE_TEXELS, gpu_data::ContactStepState};
use super::elements::GpuElements;
use super::implicit_guess::InitialState;
use super::step_resources::StepResources;
use crate::Result;
use crate::gpu::{Array, Pass, PassBuilder, Texel};
use crate::physics::GpuBody;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/lib/contact_forces.wgsl`.
        pub struct ContactParams {
            pub items: u32,
            pub dt: f32,
            pub static_friction_speed: f32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_step_start.wgsl`.
        pub struct InitParams {
            pub initial_activation_distance: f32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_solve_gate.wgsl`.
        pub struct SolveGateParams {
            pub max_iterations: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_direction.wgsl`.
        pub struct DirectionParams {
            pub nodes: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_ccd.wgsl`.
        pub struct CcdParams {
            pub faces: u32,
            pub dt: f32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_trial.wgsl`.
        pub struct TrialParams {
            pub nodes: u32,
            pub groups: u32,
            pub dt: f32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_slope.wgsl`.
        pub struct SlopeParams {
            pub nodes: u32,
            pub dt: f32,
            pub right: u32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_line_search.wgsl`.
        pub struct LineSearchParams {
            pub groups: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_accept.wgsl`.
        pub struct AcceptParams {
            pub nodes: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/contact_convergence.wgsl`.
        pub struct ConvergenceParams {
            pub groups: u32,
            pub has_friction: u32,
        }
    }
}
use gpu_data::{
    AcceptParams, CcdParams, ContactParams, ConvergenceParams, DirectionParams, InitParams,
    LineSearchParams, SlopeParams, SolveGateParams, TrialParams,
};

/// Arrays and passes of tool contact in a step.
#[derive(Debug)]
pub(in crate::physics) struct ContactPasses {
    trial_positions: Array,
    trial_velocities: Array,
    /// Velocities at which the normal forces of lagged friction are evaluated.
    pub lagged_velocities: Array,
    pub step_bounds: wgpu::Buffer,
    slopes: wgpu::Buffer,
}

/// Inputs of the contact passes.
#[derive(Clone, Copy)]
pub(in crate::physics) struct ContactContext<'a> {
    pub core: &'a StepResources,
    pub body: &'a GpuBody,
    pub elements: &'a GpuElements,
    pub contact: &'a GpuContact,
    pub start: &'a InitialState,
    /// Step in local units.
    pub dt: f32,
}

/// Vectors and scalars of the linear solve that the contact passes read.
#[derive(Clone, Copy)]
pub(in crate::physics) struct LinearSolveContext<'a> {
    pub solution: &'a [Array; 2],
    pub scalars: &'a wgpu::Buffer,
    pub rz_partials: &'a wgpu::Buffer,
    pub matrix: &'a Array,
    /// Also holds the initial residual, in rows from `right` on.
    pub preconditioner: &'a Array,
    pub right: u32,
    pub max_iterations: u32,
}

impl<'a> ContactContext<'a> {
    /// The state of the Newton iteration: the candidate of the step.
    fn state(&self) -> [&'a Array; 2] {
        [&self.core.next_positions, &self.core.next_velocities]
    }

    fn summing(&self, name: &'a str) -> PassBuilder<'a> {
        let workgroup = f64::from(self.core.workgroup);
        self.core.gpu.pass(name).constant("WORKGROUP", workgroup)
    }

    fn dispatch_size(&self) -> u32 {
        self.core.groups * self.core.workgroup
    }

    /// Binds the declarations of `lib/contact`.
    fn bind(&self, pass: PassBuilder<'a>) -> PassBuilder<'a> {
        let contact = self.contact;
        pass.read(self.body.nodes().array())
            .read(&self.body.masses)
            .read(&self.core.status)
            .read(&contact.tools)
            .read(&contact.fields)
    }

    /// Passes that compute the contact forces on faces and nodes moved with these velocities.
    pub fn force_passes(
        &self,
        steps: &'a ContactPasses,
        velocities: &'a Array,
    ) -> Result<[Pass; 2]> {
        let contact = self.contact;
        let params = |items: &Array| ContactParams {
            items: items.len(),
            dt: self.dt,
            static_friction_speed: contact.static_friction_speed as f32,
            _pad0: 0,
        };
        let (face_params, node_params) =
            (params(&contact.corners), params(&contact.boundary_nodes));
        let pass = self.bind(self.core.gpu.pass("physics/contact_faces"));
        let faces = pass
            .read(velocities)
            .read(&self.start.velocities)
            .read(&steps.lagged_velocities)
            .read(&contact.contact_state)
            .params(&face_params)
            .read(&contact.corners)
            .read(&contact.face_weights)
            .write(&contact.faces)
            .dispatch_items(contact.corners.len())?;
        let pass = self.bind(self.core.gpu.pass("physics/contact_nodes"));
        let nodes = pass
            .read(velocities)
            .read(&self.start.velocities)
            .read(&steps.lagged_velocities)
            .read(&contact.contact_state)
            .params(&node_params)
            .read(&contact.boundary_nodes)
            .read(&contact.around_nodes)
            .read(&contact.faces)
            .write(&contact.node_contributions)
            .dispatch_items(contact.boundary_nodes.len())?;
        Ok([faces, nodes])
    }
}

impl ContactPasses {
    /// For the body on which `contact` acts.
    pub fn new(core: &StepResources, contact: &GpuContact) -> Result<ContactPasses> {
        let (gpu, nodes) = (
            &core.gpu,
            contact.node_contributions.len() as usize / NODE_TEXELS,
        );
        let vector = |label| gpu.array(label, Texel::F32x4, nodes);
        debug_assert_eq!(
            contact.contact_state.size(),
            size_of::<ContactStepState>() as u64
        );
        Ok(ContactPasses {
            trial_positions: vector("trial positions")?,
            trial_velocities: vector("trial velocities")?,
            lagged_velocities: vector("friction velocities")?,
            step_bounds: gpu.buffer("step bounds", 8 * u64::from(core.groups))?,
            slopes: gpu.buffer("partial slopes", 16 * u64::from(core.groups))?,
        })
    }

    /// The pass before the start of a step is selected.
    pub fn init_pass(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let pass = with.core.gpu.pass("physics/contact_step_start");
        pass.write(&with.contact.tools)
            .read(&with.core.status)
            .write(&with.contact.contact_state)
            .params(&InitParams {
                initial_activation_distance: with.contact.initial_activation_distance as f32,
            })
            .dispatch_items(1)
    }

    /// Passes from the selected start, whose velocities are the first direction, to its system,
    /// assembled by the pass `begin`.
    pub fn first_system_passes(
        &self,
        with: &ContactContext<'_>,
        solved: &LinearSolveContext<'_>,
        begin: &Pass,
    ) -> Result<Vec<Pass>> {
        let [x, v] = with.state();
        let mut passes = vec![
            self.ccd_pass(with)?,
            self.trial(with)?,
            self.accept_pass(with)?,
        ];
        // The forces of tets do not depend on tools.
        let elements = with.core.force_passes(with.body, x, v, true)?;
        let tets = elements.len() - 1;
        passes.extend(elements.into_iter().take(tets));
        passes.extend(self.system(with, solved, begin)?);
        Ok(passes)
    }

    /// Passes after every few conjugate gradient iterations.
    pub fn newton_passes(
        &self,
        with: &ContactContext<'_>,
        solved: &LinearSolveContext<'_>,
        begin: &Pass,
    ) -> Result<Vec<Pass>> {
        let (core, contact) = (with.core, with.contact);
        let solve_gate = core
            .gpu
            .pass("physics/contact_solve_gate")
            .read(solved.scalars)
            .write(&core.status)
            .write(&contact.contact_state)
            .params(&SolveGateParams {
                max_iterations: solved.max_iterations,
            })
            .dispatch_items(1)?;
        let [even, odd] = solved.solution;
        let direction = core
            .gpu
            .pass("physics/contact_direction")
            .read(even)
            .read(odd)
            .read(&with.body.masses)
            .read(solved.scalars)
            .read(&core.status)
            .write(&with.start.velocities)
            .params(&DirectionParams { nodes: core.nodes })
            .dispatch_items(core.nodes)?;
        let mut passes = vec![
            solve_gate,
            direction,
            self.ccd_pass(with)?,
            self.trial(with)?,
        ];
        let (x, v) = (&self.trial_positions, &self.trial_velocities);
        passes.extend(with.force_passes(self, v)?);
        passes.extend(core.force_passes(with.body, x, v, true)?);
        passes.extend([
            self.slope(with, solved)?,
            self.line_search_pass(with)?,
            self.accept_pass(with)?,
        ]);
        passes.extend(self.system(with, solved, begin)?);
        Ok(passes)
    }

    /// The pass after the iterations recorded for a step.
    pub fn finish(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let pass = with.core.gpu.pass("physics/contact_finish");
        pass.write(&with.contact.tools)
            .write(&with.core.status)
            .write(&with.contact.contact_state)
            .dispatch_items(1)
    }

    /// Assembles the system at the accepted state, where the forces of tets are known.
    fn system(
        &self,
        with: &ContactContext<'_>,
        solved: &LinearSolveContext<'_>,
        begin: &Pass,
    ) -> Result<Vec<Pass>> {
        let (core, elements) = (with.core, with.elements);
        let [x, v] = with.state();
        let mut passes = Vec::from(with.force_passes(self, v)?);
        passes.extend(with.start.blocks(
            core,
            elements,
            x,
            (solved.matrix, with.dt, Some(with.contact)),
        )?);
        passes.extend(core.force_passes(with.body, x, v, true)?.pop());
        passes.push(begin.clone());
        let convergence = with
            .summing("physics/contact_convergence")
            .write(&with.contact.tools)
            .read(solved.rz_partials)
            .write(solved.scalars)
            .write(&core.status)
            .write(&with.contact.contact_state)
            .params(&ConvergenceParams {
                groups: core.groups,
                has_friction: u32::from(with.contact.has_friction()),
            })
            .dispatch_items(core.workgroup)?;
        passes.push(convergence);
        Ok(passes)
    }

    /// The CCD pass: the collision-free fraction of the direction.
    pub fn ccd_pass(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let params = CcdParams {
            faces: with.contact.corners.len(),
            dt: with.dt,
        };
        let [_, v] = with.state();
        with.bind(with.summing("physics/contact_ccd"))
            .read(&with.contact.corners)
            .read(v)
            .read(&with.start.velocities)
            .read(&with.contact.contact_state)
            .write(&self.step_bounds)
            .params(&params)
            .dispatch_items(with.dispatch_size())
    }

    fn trial(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let [_, v] = with.state();
        with.summing("physics/contact_trial")
            .read(with.body.nodes().array())
            .read(v)
            .read(&with.start.velocities)
            .read(&self.step_bounds)
            .read(&with.core.status)
            .write(&with.contact.contact_state)
            .write(&self.trial_positions)
            .write(&self.trial_velocities)
            .params(&TrialParams {
                nodes: with.core.nodes,
                groups: with.core.groups,
                dt: with.dt,
                _pad0: 0,
            })
            .dispatch_items(with.dispatch_size())
    }

    fn slope(&self, with: &ContactContext<'_>, solved: &LinearSolveContext<'_>) -> Result<Pass> {
        with.summing("physics/contact_slope")
            .read(&self.trial_velocities)
            .read(&with.body.velocities)
            .read(&with.start.velocities)
            .read(&with.body.masses)
            .read(&with.core.forces)
            .read(solved.preconditioner)
            .read(&with.core.status)
            .write(&self.slopes)
            .params(&SlopeParams {
                nodes: with.core.nodes,
                dt: with.dt,
                right: solved.right,
                _pad0: 0,
            })
            .dispatch_items(with.dispatch_size())
    }

    fn line_search_pass(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let params = LineSearchParams {
            groups: with.core.groups,
        };
        with.summing("physics/contact_line_search")
            .write(&with.contact.tools)
            .read(&self.slopes)
            .write(&with.core.status)
            .write(&with.contact.contact_state)
            .params(&params)
            .dispatch_items(with.core.workgroup)
    }

    fn accept_pass(&self, with: &ContactContext<'_>) -> Result<Pass> {
        let [x, v] = with.state();
        let params = AcceptParams {
            nodes: with.core.nodes,
        };
        let pass = with.core.gpu.pass("physics/contact_accept");
        pass.read(&self.trial_positions)
            .read(&self.trial_velocities)
            .read(&with.core.status)
            .read(&with.contact.contact_state)
            .write(x)
            .write(v)
            .write(&self.lagged_velocities)
            .params(&params)
            .dispatch_items(with.core.nodes)
    }
}
