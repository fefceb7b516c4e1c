//! Seeing inside: cameras, transfer functions, and the raycaster that walks the tets.
//!
//! Nothing here knows of physics: positions are an array on the GPU that anyone may write.

mod camera;
mod presets;
mod transfer;

pub use camera::{Camera, Projection, Ray};
pub use transfer::{ResolvedTransfer, TransferFunction};
