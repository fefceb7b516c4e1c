//! Palpate: press on a body and see inside it while it gives.
//!
//! Deformable tetrahedral meshes are simulated on the GPU and drawn by a volume raycaster that
//! walks the deformed tetrahedra, with nothing read back in between. The methods are those of
//! Tejada & Ertl, *Large Steps in GPU-based Deformable Bodies Simulation* (2005), carried further.
//!
//! Data flows one way: file → [`mesh::TetMesh`] → body (textures on the GPU) → solver step →
//! refresh of normals and gradients → raycast → image. `ARCHITECTURE.md` is the map.

pub mod annotate;
pub mod cage;
pub mod error;
mod files;
pub mod gpu;
pub mod io;
pub mod mesh;
pub mod mesher;
pub(crate) mod parallel;
pub mod physics;
pub mod press;
mod progress;
pub mod render;
pub mod scene;
pub mod skin;
#[cfg(feature = "study")]
pub mod study;
pub mod tune;
pub mod volume;
pub mod warp;

pub use error::{Error, FailureCause, Result};
/// The version of glam that this library's vectors and matrices are of.
pub use glam;
pub use progress::{ProgressFn, no_progress};
/// The version of wgpu that this library's devices, textures and encoders are of.
pub use wgpu;
