//! Spring-mass bodies on a regular grid with implicit connections: each particle has its 18
//! neighbours at fixed distances in one array, no index lists (Mosegaard, Herborg & Sørensen,
//! *A GPU Accelerated Spring-Mass System for Surgical Simulation*, 2005).
//!
//! The array of positions is the paper's flat 3D texture: particle (x, y, z) is item
//! x + nx (y + ny z). What draws or carries other bodies takes it as it takes theirs.

mod mesh_filter;
pub(super) mod model;
pub mod reference;
pub(super) mod shape;

pub use crate::physics::gpu::grid::body::GridBody;
pub use crate::physics::gpu::grid::cut::GridCut;
pub use crate::physics::gpu::grid::simulator::GpuGrid;
pub use crate::physics::gpu::grid::state::GridState;
pub(crate) use mesh_filter::retain_tets;
pub use model::GridModel;
pub(crate) use model::isotropic_stiffness;
pub use shape::{GridShape, SPRING_KINDS, SPRING_OFFSETS};
