//! Largest stable steps, from the eigenvalues of a linearised body and the step matrices of schemes.

pub(super) mod advice;
pub(super) mod lanczos;
pub mod linearised_model;
mod mode;
pub(super) mod step_limit;
