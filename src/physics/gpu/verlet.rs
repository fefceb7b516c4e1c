//! The Verlet scheme x' = 2x − x₋₁ + h² a on the GPU; `shaders/physics/verlet.wgsl`, with the
//! reference `physics::plain::steppers::Verlet`.
//!
//! It stores the increment v = (x − x₋₁)/h, which avoids cancellation in f32. A first step, or one
//! after a change of the step length, uses the mean of the two lengths, which for h₋₁ = 0 is the
//! start x₋₁ = x₀ − h v₀ + ½h² a₀.

use super::explicit_pass;
use super::integrator::{Integrator, Stage, Step, StepResources, Timing};
use crate::Result;
use crate::physics::{GpuBody, SolverKind};

/// The scheme has no state besides its pass.
#[derive(Debug)]
pub struct Scheme;

impl Integrator for Scheme {
    const KIND: SolverKind = SolverKind::Verlet;

    fn new(_: &StepResources, _: &GpuBody) -> Result<Scheme> {
        Ok(Scheme)
    }

    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step> {
        let pass = |kick| {
            let target = &core.next_velocities;
            explicit_pass::explicit_pass(core, body, "physics/verlet", target, timing.dt, kick)
        };
        let kicked = |kick| pass(kick).map(|pass| Some(Stage::Passes(vec![pass])));
        Ok(Step {
            first_stage_on_restart: kicked(0.5 * timing.dt)?,
            after_change: kicked(0.5 * (timing.previous_dt + timing.dt))?,
            ..Step::explicit(pass(timing.dt)?)
        })
    }
}
