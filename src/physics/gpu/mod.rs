//! The GPU engine of tetrahedral bodies: arrays, integrators and the passes of their steps.

pub(super) mod body;
pub(super) mod contact;
#[cfg(test)]
pub(super) mod contact_tests;
pub(super) mod cut;
pub(super) mod edges;
pub(super) mod elements;
pub(super) mod explicit_euler;
pub(super) mod explicit_pass;
pub(super) mod grab_lists;
pub(super) mod grid;
pub(super) mod implicit_contact;
pub(super) mod implicit_euler;
pub(super) mod implicit_guess;
mod implicit_passes;
pub(super) mod implicit_rigid;
pub mod integrator;
pub(super) mod new_solver;
#[cfg(test)]
pub(super) mod reference_tests;
pub(super) mod report;
pub(super) mod rigid;
pub(super) mod simulator;
pub(super) mod sliced_ellpack;
pub(super) mod solver;
pub(super) mod springs;
pub(super) mod state;
pub(super) mod status;
pub(super) mod step_resources;
pub(super) mod stepper;
pub(super) mod symplectic_euler;
pub(super) mod terms;
pub(super) mod velocity_verlet;
pub(super) mod verlet;

use stepper::Stepper;

/// Explicit Euler: x' = x + h v, v' = v + h a. Never stable without damping.
pub type ExplicitEuler = Stepper<explicit_euler::Scheme>;
/// Symplectic Euler: v' = v + h a, x' = x + h v'.
pub type SymplecticEuler = Stepper<symplectic_euler::Scheme>;
/// Verlet: x' = 2x − x₋₁ + h² a, started with x₋₁ = x₀ − h v₀ + ½h² a₀. Damping acts on the
/// velocity half a step ago: of second order without damping, of first order with it.
pub type Verlet = Stepper<verlet::Scheme>;
/// Velocity Verlet: x' = x + h (v + ½h a), v' = v + ½h (a + a'), a' = a(x', v + h a): of second
/// order with damping too.
pub type VelocityVerlet = Stepper<velocity_verlet::Scheme>;
/// Implicit Euler after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h(f + h K̃ v).
pub type ImplicitEuler = Stepper<implicit_euler::ImplicitEulerScheme>;
