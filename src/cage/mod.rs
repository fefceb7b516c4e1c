//! Coarse bodies that carry fine meshes: no more is simulated than a scene needs.
//!
//! A [`Cage`] is made from a fine body: cells around its mesh, with its mass and stiffness. The
//! cage is simulated; an [`Embedding`] carries the nodes of the fine mesh along, so that the fine
//! mesh is what is drawn.

mod embedded_simulator;
mod embedding;
mod lattice;
mod model;
mod stiffness_fit;

pub use embedded_simulator::EmbeddedSimulator;
pub use embedding::Embedding;
pub use model::{Cage, CageKind, CageReport};
pub(crate) use stiffness_fit::Compliance;
