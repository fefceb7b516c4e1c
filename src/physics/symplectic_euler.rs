//! Symplectic Euler; the twin of `shaders/physics/symplectic_euler.wgsl` and `physics::plain::steppers::symplectic_euler`.

use super::step::{Core, StepPasses, Timing};
use super::stepper;
use super::{Body, SolverKind, moves};
use crate::Result;

/// Nothing but its pass.
#[derive(Debug)]
pub struct Scheme;

impl stepper::Scheme for Scheme {
    const KIND: SolverKind = SolverKind::Symplectic;

    fn new(_: &Core, _: &Body) -> Result<Scheme> {
        Ok(Scheme)
    }

    fn passes(&self, core: &Core, body: &Body, timing: Timing) -> Result<StepPasses> {
        let target = &core.next_velocities;
        Ok(StepPasses {
            before: vec![moves::pass(
                core,
                body,
                "physics/symplectic_euler",
                target,
                timing.dt,
                timing.dt,
            )?],
            ..StepPasses::default()
        })
    }
}
