//! What most programs need, for `use palpate::prelude::*`: a device, a scene and its stage, or a
//! body with its material and solver, and what renders it.

pub use crate::gpu::Gpu;
pub use crate::physics::{EngineChoice, Material, SolverKind};
pub use crate::render::{Camera, Geometry, Raycaster, TransferFunction};
pub use crate::scene::{Scene, Stage};
