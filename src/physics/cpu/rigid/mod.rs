//! Rigid regions: their layout as nodes, poses, loads and the springs to targets.

pub(super) mod bodies;
pub(super) mod closest_rotation;
pub(super) mod layout;
pub(super) mod loads;
pub(super) mod midpoint;
pub(super) mod pose;
pub(super) mod target_springs;
#[cfg(test)]
pub(super) mod tests;
