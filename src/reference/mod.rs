//! What the GPU is held against: the same quantities in float64 on the CPU.

pub mod cage;
pub mod culling;
pub mod elements;
mod first_hit;
pub mod grid;
mod lanczos;
pub mod linear;
mod ray_integral;
pub mod skin;
pub mod spectrum;
pub mod springs;
pub mod steppers;
mod tet_geometry;
pub mod truth;

pub use first_hit::{Hit, first_hit};
pub use ray_integral::{RayReference, Segment, segment_integral};
pub use tet_geometry::{tet_gradient, tet_planes};
