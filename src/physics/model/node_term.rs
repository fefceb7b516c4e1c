//! Energy terms that act on each node separately, besides the springs and elements.
//!
//! A term has one file here, its float64 form, and one in `shaders/terms`, whose functions
//! `NAME_force` and `NAME_block` are composed into the passes that gather forces and assemble
//! linear systems. A node is therefore visited once, however many terms there are.

use crate::mesh::LocalFrame;
use crate::physics::LocalUnits;
use glam::{DMat3, DVec3};
use std::fmt::Debug;

/// An energy term of each node by itself. Positions are in metres from the frame's origin.
pub trait NodeTerm: Debug + Send + Sync {
    /// The name of its file in `shaders/terms` and the prefix of the functions in it.
    fn name(&self) -> &'static str;

    /// Its parameters as the shader reads them, in local units.
    fn shader_parameters(
        &self,
        frame: &LocalFrame,
        units: &LocalUnits,
        length_unit: f64,
    ) -> [[f32; 4]; 2];

    /// Returns the energy of a node of mass `m` (kg) at `x`, J.
    fn energy(&self, m: f64, x: DVec3) -> f64;

    /// Returns the force −∂E/∂x on the node, N.
    fn force(&self, m: f64, x: DVec3) -> DVec3;

    /// Returns the Hessian −∂f/∂x, N/m: symmetric and positive semidefinite.
    fn hessian(&self, m: f64, x: DVec3) -> DMat3;

    /// Returns the largest eigenvalue of [`NodeTerm::hessian`] for a node of mass `m`, N/m. It
    /// bounds the step of explicit schemes.
    fn max_stiffness(&self, m: f64) -> f64;
}
