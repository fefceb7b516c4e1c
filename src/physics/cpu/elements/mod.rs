//! Finite elements: batches of tets, their kernels, averaged nodal volumes and muscles.

pub(super) mod batch;
pub(super) mod damping_derivatives;
#[cfg(test)]
mod damping_tests;
pub(super) mod element_batch;
pub(super) mod kernels;
pub(super) mod muscle;
#[cfg(test)]
pub(super) mod nodal_volume_tests;
pub(super) mod nodal_volumes;
pub(super) mod quadratic_batch;
#[cfg(test)]
pub(super) mod quadratic_tests;
pub(super) mod svd;
pub(super) mod term;
#[cfg(test)]
pub(super) mod tests;
