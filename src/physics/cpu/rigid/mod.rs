//! Rigid regions: node layout, poses, loads and target springs.

pub(super) mod bodies;
pub(super) mod closest_rotation;
pub(super) mod layout;
pub(super) mod loads;
pub(super) mod midpoint;
pub(super) mod midpoint_adjoint;
pub(super) mod pose;
pub(super) mod projection;
pub(super) mod target_springs;
#[cfg(test)]
pub(super) mod tests;
