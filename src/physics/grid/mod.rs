//! Mass-spring bodies on a regular grid with implicit connectivity: each particle has 18 neighbours
//! at fixed offsets in one array, without index lists (Mosegaard, Herborg & Sørensen, *A GPU
//! Accelerated Spring-Mass System for Surgical Simulation*, 2005).
//!
//! The position array is the paper's flat 3D texture: particle (x, y, z) is item x + nx (y + ny z).
//! Drawing and embedding use it like the nodes of other bodies.

mod mesh_filter;
pub(super) mod model;
pub mod reference;
pub(super) mod shape;

pub(crate) use mesh_filter::retain_tets;
pub use model::GridModel;
pub(crate) use model::isotropic_stiffness;
pub use shape::GridShape;
pub(crate) use shape::SPRING_KINDS;
