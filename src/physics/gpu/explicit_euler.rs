//! Explicit Euler on the GPU; `shaders/physics/explicit_euler.wgsl`, with the reference
//! `physics::plain::steppers::explicit_euler`.

use super::explicit_pass;
use super::integrator::{Integrator, Step, StepResources, Timing};
use crate::Result;
use crate::physics::{GpuBody, SolverKind};

/// The scheme has no state besides its pass.
#[derive(Debug)]
pub struct Scheme;

impl Integrator for Scheme {
    const KIND: SolverKind = SolverKind::Explicit;

    fn new(_: &StepResources, _: &GpuBody) -> Result<Scheme> {
        Ok(Scheme)
    }

    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step> {
        let (target, dt) = (&core.next_velocities, timing.dt);
        let pass =
            explicit_pass::explicit_pass(core, body, "physics/explicit_euler", target, dt, dt)?;
        Ok(Step::explicit(pass))
    }
}
