//! Resources shared by the step passes of all solvers: the candidate state, the forces, the guard.

use super::body::ChangeCounter;
use super::integrator::Step;
use super::status::gpu_data::Status;
use super::status::{ENERGY_FACTOR, ENERGY_FLOOR, HISTORY};
use super::terms::ProgramPart;
use crate::Result;
use crate::gpu::{Array, Gpu, Pass, Texel};
use crate::physics::GpuBody;
use crate::physics::loads::LoadVersions;
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/forces.wgsl`.
        pub struct ForceParams {
            pub gravity: [f32; 4],
            pub nodes: u32,
            pub newton: f32,
            pub _pad0: u32,
            pub _pad1: u32,
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
            pub allow_inversion: u32,
            pub _pad0: u32,
        }
    }
}
use gpu_data::{CheckParams, ForceParams};

/// Resources of all integrators on the GPU: the candidate state, the forces, and the guard.
#[derive(Debug)]
pub struct StepResources {
    pub(in crate::physics) gpu: Gpu,
    pub(in crate::physics) nodes: u32,
    /// Workgroup size and number of workgroups of passes that sum over the nodes.
    pub(in crate::physics) workgroup: u32,
    pub(in crate::physics) groups: u32,
    pub(in crate::physics) next_positions: Array,
    pub(in crate::physics) next_velocities: Array,
    pub(in crate::physics) forces: Array,
    pub(in crate::physics) partials: wgpu::Buffer,
    pub(in crate::physics) status: wgpu::Buffer,
    pub(in crate::physics) history: wgpu::Buffer,
    pub(in crate::physics) body: u64,
    /// Number of cuts of the body when the arrays were created.
    pub(in crate::physics) generation: u64,
    pub(in crate::physics) texels: u32,
}

/// Passes ready to be recorded, and what they depend on.
#[derive(Debug)]
pub(in crate::physics) struct PreparedStep {
    pub(in crate::physics) dt: f64,
    pub(in crate::physics) local_dt: f32,
    pub(in crate::physics) gravity: DVec3,
    pub(in crate::physics) inversion_allowed: bool,
    /// Revision of the body that was last prepared.
    pub(in crate::physics) revision: ChangeCounter,
    pub(in crate::physics) step: Step,
    /// Versions of the loads for which `grab_springs` was created.
    pub(in crate::physics) loads: Option<LoadVersions>,
    /// Computes the forces of spring grabs at the candidate's positions.
    pub(in crate::physics) grab_springs: Option<Pass>,
    pub(in crate::physics) forces: Vec<Pass>,
    pub(in crate::physics) check: Pass,
    pub(in crate::physics) commit: Pass,
    /// Clears a failure.
    pub(in crate::physics) clear_failure: Pass,
    /// Before the first step after an external change: recomputes everything from the new state.
    pub(in crate::physics) restart: Vec<Pass>,
    /// Before the first step of any other recording: external forces may have changed.
    pub(in crate::physics) refresh_loads: Vec<Pass>,
}

/// Workgroup size and number of workgroups of passes that sum over `nodes`.
fn workgroups(gpu: &Gpu, nodes: usize) -> (u32, u32) {
    // On a software adapter a workgroup costs microseconds, so use a few per core; a GPU needs
    // many.
    let cores = std::thread::available_parallelism().map_or(4, usize::from) as u32;
    let (workgroup, most) = match gpu.adapter().device_type {
        wgpu::DeviceType::Cpu => (64, (4 * cores).min(256)),
        _ => (256, 512),
    };
    let groups = (nodes as u32).div_ceil(workgroup).clamp(1, most);
    (workgroup, groups)
}

impl StepResources {
    pub(in crate::physics) fn new(gpu: &Gpu, body: &GpuBody) -> Result<StepResources> {
        let nodes = body.node_count();
        let (workgroup, groups) = workgroups(gpu, nodes);
        let array = |label| gpu.array_with_headroom(label, Texel::F32x4, nodes);
        Ok(StepResources {
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
            texels: body.material_term().texels(),
        })
    }

    /// Resizes the arrays after a cut of the body; the step count continues.
    pub(in crate::physics) fn follow(&mut self, body: &GpuBody) -> Result<()> {
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
        self.texels = body.material_term().texels();
        Ok(())
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of nodes.
    pub fn nodes(&self) -> u32 {
        self.nodes
    }

    /// Output array of the positions at the end of the step, in local units.
    pub fn next_positions(&self) -> &Array {
        &self.next_positions
    }

    /// Output array of the velocities at the end of the step, in local units.
    pub fn next_velocities(&self) -> &Array {
        &self.next_velocities
    }

    /// The forces of the latest [`Stage::Forces`](super::integrator::Stage::Forces), in local
    /// units; before it, those at the start of the step.
    pub fn forces(&self) -> &Array {
        &self.forces
    }

    /// The status buffer; its first word is nonzero once a step has failed, and passes then leave
    /// everything unchanged (`lib/status.wgsl`).
    pub fn status(&self) -> &wgpu::Buffer {
        &self.status
    }

    pub(in crate::physics) fn prepare(
        &self,
        body: &GpuBody,
        step: Step,
        dt: f64,
        local_dt: f32,
    ) -> Result<PreparedStep> {
        let seen = step.velocities()?;
        let velocities = seen.unwrap_or(&self.next_velocities);
        let state = body.nodes().array();
        // Contact forces are known at the end of a step only, and their work is counted there.
        let mut restart = self.force_passes(body, state, &body.velocities, false)?;
        restart.push(self.check_pass(body, 2, local_dt)?);
        let kept = seen.unwrap_or(&body.velocities);
        let mut resume = self.force_passes(body, state, kept, false)?;
        resume.push(self.check_pass(body, 1, local_dt)?);
        Ok(PreparedStep {
            dt,
            local_dt,
            gravity: body.gravity(),
            inversion_allowed: body.inversion_allowed,
            revision: body.revision(),
            loads: None,
            grab_springs: None,
            forces: self.force_passes(body, &self.next_positions, velocities, true)?,
            check: self.check_pass(body, 0, local_dt)?,
            commit: self
                .gpu
                .pass("physics/commit")
                .read(&self.next_positions)
                .read(&self.next_velocities)
                .read(&self.status)
                .write(state)
                .write(&body.velocities)
                .dispatch_items(self.nodes)?,
            clear_failure: self
                .gpu
                .pass("physics/reset_status")
                .write(&self.status)
                .dispatch_items(1)?,
            restart,
            refresh_loads: resume,
            step,
        })
    }

    /// Passes that compute the forces and energies at a state; with the latest contact forces of
    /// tools, if there are any and they count.
    pub(in crate::physics) fn force_passes(
        &self,
        body: &GpuBody,
        positions: &Array,
        velocities: &Array,
        tools: bool,
    ) -> Result<Vec<Pass>> {
        let matter = body.material_term();
        let before = matter.prepare_forces(&self.gpu, positions, velocities, &self.status)?;
        let units = &body.units;
        let gravity = (body.gravity() / units.acceleration()).as_vec3();
        let params = ForceParams {
            gravity: gravity.extend(0.0).to_array(),
            nodes: self.nodes,
            newton: (1.0 / units.force()) as f32,
            _pad0: 0,
            _pad1: 0,
        };
        let name = body.shader_name_with_contact("physics/forces", tools);
        let pass = self
            .gpu
            .pass(&name)
            .constant("WORKGROUP", f64::from(self.workgroup))
            .read(positions)
            .read(velocities)
            .read(&body.masses)
            .read(&body.external)
            .read(&self.status)
            .write(&self.forces)
            .write(&self.partials)
            .params(&params);
        let threads = self.groups * self.workgroup;
        let gather = body
            .bind_pressed(pass, ProgramPart::Forces, tools)
            .dispatch_items(threads)?;
        Ok(before.into_iter().chain([gather]).collect())
    }

    /// Builds the check pass; `kind` as in `shaders/physics/check.wgsl`.
    fn check_pass(&self, body: &GpuBody, kind: u32, local_dt: f32) -> Result<Pass> {
        let params = CheckParams {
            kind,
            groups: self.groups,
            history: HISTORY,
            dt: local_dt,
            floor: (ENERGY_FLOOR * f64::from(self.nodes)) as f32,
            factor: ENERGY_FACTOR as f32,
            allow_inversion: body.inversion_allowed.into(),
            _pad0: 0,
        };
        self.gpu
            .pass("physics/check")
            .constant("WORKGROUP", f64::from(self.workgroup))
            .read(&self.partials)
            .write(&self.status)
            .write(&self.history)
            .params(&params)
            .dispatch_items(self.workgroup)
    }
}
