//! Velocity Verlet on the GPU; `shaders/physics/velocity_verlet*.wgsl`, with the reference
//! `physics::plain::steppers::VelocityVerlet`.
//!
//! The forces at the end of a step are reused at the start of the next. Their damping part uses the
//! predicted velocity v + h a instead of the v + ½h a that moved the nodes: this makes damping
//! second-order accurate in h like the rest of the scheme (Groot & Warren 1997 with λ = 1), where
//! damping alone halves the stable step.

use super::explicit_pass;
use super::integrator::{Integrator, Stage, Step, StepResources, Timing};
use crate::Result;
use crate::gpu::{Array, Texel};
use crate::physics::{GpuBody, SolverKind};

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/velocity_verlet_kick.wgsl`.
        pub struct KickParams {
            pub nodes: u32,
            pub kick: f32,
        }
    }
}
use gpu_data::KickParams;

/// The predicted velocities at the end of the step, v + h a.
#[derive(Debug)]
pub struct Scheme {
    predicted_velocities: Array,
}

impl Integrator for Scheme {
    const KIND: SolverKind = SolverKind::VelocityVerlet;

    fn new(core: &StepResources, body: &GpuBody) -> Result<Scheme> {
        let nodes = body.node_count();
        Ok(Scheme {
            predicted_velocities: core.gpu.array_with_headroom(
                "predicted velocities",
                Texel::F32x4,
                nodes,
            )?,
        })
    }

    fn apply_cut(&mut self, core: &StepResources, body: &GpuBody) -> Result<()> {
        let predicted = &mut self.predicted_velocities;
        core.gpu
            .resize(predicted, "predicted velocities", body.node_count())?;
        Ok(())
    }

    fn history_arrays(&self) -> Vec<&Array> {
        vec![&self.predicted_velocities]
    }

    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step> {
        let (dt, kick) = (timing.dt, 0.5 * timing.dt);
        let predicted = &self.predicted_velocities;
        let shader = "physics/velocity_verlet";
        let moved = explicit_pass::explicit_pass(core, body, shader, predicted, dt, kick)?;
        let kicked = core
            .gpu
            .pass("physics/velocity_verlet_kick")
            .read(&body.velocities)
            .read(predicted)
            .read(&core.forces)
            .read(&body.masses)
            .read(&core.status)
            .write(&core.next_velocities)
            .params(&KickParams {
                nodes: core.nodes,
                kick,
            })
            .dispatch_items(core.nodes)?;
        Ok(Step {
            stages: vec![
                Stage::Passes(vec![moved]),
                Stage::Forces(Some(predicted.clone())),
                Stage::Passes(vec![kicked]),
            ],
            ..Step::default()
        })
    }
}
