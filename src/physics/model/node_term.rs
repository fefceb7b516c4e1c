//! Terms of the energy that act on each node by itself, beside the springs.
//!
//! A term is one file here, with its form in float64, and one in `shaders/terms`, whose functions
//! `NAME_force` and `NAME_block` are composed into the passes that gather forces and set up linear
//! systems: however many terms there are, a node is visited once.

use crate::mesh::LocalFrame;
use crate::physics::LocalUnits;
use glam::{DMat3, DVec3};
use std::fmt::Debug;

/// What acts on every node of a body by itself. Positions are in metres from the frame's origin.
pub trait NodeTerm: Debug + Send + Sync {
    /// The name of its file in `shaders/terms`, and of what that calls its functions.
    fn name(&self) -> &'static str;

    /// Its numbers as that file reads them, in local units.
    fn gpu_parameters(
        &self,
        frame: &LocalFrame,
        units: &LocalUnits,
        length_unit: f64,
    ) -> [[f32; 4]; 2];

    /// Energy of a node of mass `m` (kg) at `x`, J.
    fn energy(&self, m: f64, x: DVec3) -> f64;

    /// The force on it, N: −∂E/∂x.
    fn force(&self, m: f64, x: DVec3) -> DVec3;

    /// −∂f/∂x, N/m: symmetric and positive semidefinite.
    fn hessian(&self, m: f64, x: DVec3) -> DMat3;

    /// The largest eigenvalue that [`NodeTerm::hessian`] has for a node of mass `m`, N/m: what
    /// bounds the step of explicit schemes.
    fn max_stiffness(&self, m: f64) -> f64;
}
