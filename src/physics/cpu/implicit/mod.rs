//! The implicit step: schemes, Newton's method, the line search and the updates of contact.

pub(super) mod block_jacobi;
pub(super) mod contact_iterations;
pub(super) mod contact_terms;
mod friction_updates;
pub(super) mod initial_guess;
pub(super) mod line_search;
pub(super) mod linear_step;
pub(super) mod newton;
mod newton_direction;
mod newton_iterations;
pub(super) mod push_out;
pub(super) mod residual;
pub(super) mod schemes;
#[cfg(test)]
pub(super) mod tests;
pub(super) mod trial_state;
