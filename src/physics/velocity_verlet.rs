//! Velocity Verlet; the twin of `shaders/physics/velocity_verlet*.wgsl` and
//! `reference::steppers::VelocityVerlet`.
//!
//! The forces at the end of a step are those that the next begins with.

use super::stepper::{self, Core, StepPasses, Timing};
use super::{Body, SolverKind, moves};
use crate::Result;
use crate::gpu::{Array, Texel};

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

/// The velocities in the middle of the step.
#[derive(Debug)]
pub struct Scheme {
    half_velocities: Array,
}

impl stepper::Scheme for Scheme {
    const KIND: SolverKind = SolverKind::VelocityVerlet;

    fn new(core: &Core, body: &Body) -> Result<Scheme> {
        let nodes = body.node_count();
        Ok(Scheme {
            half_velocities: core
                .gpu
                .roomy_array("half velocities", Texel::F32x4, nodes)?,
        })
    }

    fn follow(&mut self, core: &Core, body: &Body) -> Result<()> {
        let half = &mut self.half_velocities;
        core.gpu
            .resize(half, "half velocities", body.node_count())?;
        Ok(())
    }

    fn passes(&self, core: &Core, body: &Body, timing: Timing) -> Result<StepPasses> {
        let (dt, kick) = (timing.dt, 0.5 * timing.dt);
        let half = &self.half_velocities;
        Ok(StepPasses {
            before: vec![moves::pass(
                core,
                body,
                "physics/velocity_verlet",
                half,
                dt,
                kick,
            )?],
            velocities: Some(half.clone()),
            after: vec![
                core.gpu
                    .pass("physics/velocity_verlet_kick")
                    .read(half)
                    .read(&core.forces)
                    .read(&body.masses)
                    .read(&core.status)
                    .write(&core.next_velocities)
                    .params(&KickParams {
                        nodes: core.nodes,
                        kick,
                    })
                    .over(core.nodes)?,
            ],
            ..StepPasses::default()
        })
    }
}
