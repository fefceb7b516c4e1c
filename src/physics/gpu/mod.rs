//! The GPU engine of tetrahedral bodies: arrays, integrators and the passes of their steps.

pub(super) mod body;
pub(super) mod contact;
#[cfg(test)]
pub(super) mod contact_tests;
pub(super) mod cut;
pub(super) mod elements;
pub(super) mod explicit_euler;
pub(super) mod explicit_pass;
pub(super) mod grab_lists;
pub(super) mod grid;
pub(super) mod implicit_contact;
pub(super) mod implicit_euler;
pub(super) mod implicit_guess;
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
