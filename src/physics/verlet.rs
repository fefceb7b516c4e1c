//! Verlet's scheme, x' = 2x − x₋₁ + h² a; the twin of `shaders/physics/verlet.wgsl` and
//! `physics::plain::steppers::Verlet`.
//!
//! What is kept is the increment v = (x − x₋₁)/h, which loses no digits in f32. A first step, or
//! one of another length than the last, is kicked by the mean of the two lengths, which for
//! h₋₁ = 0 is the start x₋₁ = x₀ − h v₀ + ½h² a₀.

use super::step::{Core, StepPasses, Timing};
use super::stepper;
use super::{Body, SolverKind, moves};
use crate::Result;

/// Nothing but its pass.
#[derive(Debug)]
pub struct Scheme;

impl stepper::Scheme for Scheme {
    const KIND: SolverKind = SolverKind::Verlet;

    fn new(_: &Core, _: &Body) -> Result<Scheme> {
        Ok(Scheme)
    }

    fn passes(&self, core: &Core, body: &Body, timing: Timing) -> Result<StepPasses> {
        let pass = |kick| {
            let target = &core.next_velocities;
            moves::pass(core, body, "physics/verlet", target, timing.dt, kick)
        };
        Ok(StepPasses {
            before: vec![pass(timing.dt)?],
            after_restart: Some(vec![pass(0.5 * timing.dt)?]),
            after_change: Some(vec![pass(0.5 * (timing.before + timing.dt))?]),
            ..StepPasses::default()
        })
    }
}
