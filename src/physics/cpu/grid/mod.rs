//! Grid bodies: particles with springs at fixed offsets.

pub(super) mod body;
pub(super) mod forces;
pub(super) mod normals;
pub(super) mod simulator;
pub(super) mod step;
mod steppable;
#[cfg(test)]
pub(super) mod tests;
