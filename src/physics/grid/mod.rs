//! Spring-mass bodies on a regular grid with implicit connections: each particle has its 18
//! neighbours at fixed distances in one array, no index lists (Mosegaard, Herborg & Sørensen,
//! *A GPU Accelerated Spring-Mass System for Surgical Simulation*, 2005).
//!
//! The array of positions is the paper's flat 3D texture: particle (x, y, z) is item
//! x + nx (y + ny z). What draws or carries other bodies takes it as it takes theirs.

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
