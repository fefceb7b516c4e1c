//! Mass-spring bodies on a regular grid with implicit connectivity: each particle has 18 neighbours
//! at fixed offsets in one array, without index lists (Mosegaard, Herborg & Sørensen, *A GPU
//! Accelerated Spring-Mass System for Surgical Simulation*, 2005).
//!
//! The position array is the paper's flat 3D texture: particle (x, y, z) is item x + nx (y + ny z).
//! Drawing and embedding use it like the nodes of other bodies.

mod body;
mod cut;
mod model;
pub mod plain;
mod shape;
mod simulator;
mod state;
mod verlet;

pub use body::GridBody;
pub use cut::GridCut;
pub(crate) use cut::retain_tets;
pub use model::GridModel;
pub(crate) use model::isotropic_stiffness;
pub use shape::{GridShape, SPRING_KINDS, SPRING_OFFSETS};
pub use simulator::GpuGrid;
pub use state::GridState;
