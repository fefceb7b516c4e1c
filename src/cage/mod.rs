//! Coarse bodies that carry fine meshes: no more is simulated than a scene needs.
//!
//! A [`Cage`] is made from a fine body: cells around its mesh, with its mass and stiffness. The
//! cage is simulated; an [`Embedding`] carries the nodes of the fine mesh along, so that the fine
//! mesh is what is drawn.

mod carried;
mod cells;
mod embedding;
mod fit;
mod model;

pub use carried::EmbeddedSimulator;
pub use embedding::Embedding;
pub(crate) use fit::Compliance;
pub use model::{Cage, CageKind, CageReport};
