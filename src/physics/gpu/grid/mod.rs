//! The GPU engine of grid bodies.

pub(in crate::physics) mod body;
pub(in crate::physics) mod cut;
pub(in crate::physics) mod simulator;
pub(in crate::physics) mod state;
pub(in crate::physics) mod verlet;
