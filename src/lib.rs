//! Palpate: simulation of deformable tetrahedral meshes with contact, and rendering of their
//! interior.
//!
//! The meshes are simulated on the GPU and rendered by a volume raycaster that traverses the
//! deformed tetrahedra, without read-back in between. The methods extend those of Tejada & Ertl,
//! *Large Steps in GPU-based Deformable Bodies Simulation* (2005).
//!
//! Data flows one way: file → [`mesh::TetMesh`] → body (textures on the GPU) → solver step →
//! refresh of normals and gradients → raycast → image. `ARCHITECTURE.md` gives an overview.

pub mod accuracy;
pub mod annotate;
#[cfg(feature = "study")]
pub mod bench;
pub mod cage;
pub mod error;
mod files;
pub mod generate;
pub mod gpu;
#[cfg(feature = "identify")]
pub mod identify;
pub mod io;
pub mod mesh;
pub mod mesher;
pub mod meshing;
pub mod number_format;
pub(crate) mod parallel;
pub mod physics;
pub mod prelude;
pub mod press;
mod progress;
#[cfg(any(feature = "study", test))]
mod random;
pub mod render;
pub mod scene;
pub mod skin;
#[cfg(feature = "study")]
pub mod study;
pub mod tune;
pub mod volume;
pub mod warp;

pub use error::{Error, FailureCause, Result};
/// The version of glam used for vectors and matrices in the public API.
pub use glam;
pub use progress::{ProgressFn, no_progress};
/// The version of wgpu used for devices, textures and encoders in the public API.
pub use wgpu;
