//! What the GPU is held against: the same quantities in float64 on the CPU.

mod ray_integral;
pub mod springs;
pub mod steppers;

pub use ray_integral::{RayReference, Segment, segment_integral};
