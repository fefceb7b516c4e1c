//! Gradients of a quantity of a body by its parameters, by the adjoint method: at rest the engine
//! solves one linear system ([`StaticAdjoint`](super::cpu::StaticAdjoint)), for a motion one for
//! each step ([`MotionAdjoint`](super::cpu::MotionAdjoint)); here the solutions are contracted with
//! the derivatives of the forces by each parameter.
//!
//! With λ from the engine, dQ/dp = ∂Q/∂p + Σ λ·∂f/∂p at fixed positions. Element forces and
//! energies are linear in μ and λ, so that their derivatives are exact; those by rest positions,
//! and of stresses, are central differences of fourth order.

mod equilibrium;
mod motion;
mod parameters;
mod quantities;
mod rest_positions;
mod simulator;
mod slopes;
#[cfg(test)]
mod tests;
