//! Embedded deformation: coarse simulated bodies that deform fine meshes.
//!
//! A [`Cage`] is created from a fine body: cells around its mesh, with its mass and stiffness. Only
//! the cage is simulated; an [`Embedding`] interpolates the nodes of the fine mesh for rendering.

mod cells_to_body;
mod embedded_simulator;
mod embedding;
mod lattice;
mod model;
mod stiffness_fit;

pub use embedded_simulator::EmbeddedSimulator;
pub use embedding::Embedding;
pub use model::{Cage, CageKind, CageReport};
pub(crate) use stiffness_fit::Compliance;
