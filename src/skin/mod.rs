//! Skins: detailed surfaces embedded in the nodes of a coarser body.
//!
//! After Mosegaard & Sørensen, *Real-time Deformation of Detailed Geometry Based on Mappings to a
//! Less Detailed Physical Simulation on the GPU* (2005). Every vertex is bound once, on the CPU, to
//! three nodes of the body; the vertex shader computes its deformed position from the position
//! texture. Drawing reads nothing back, and bindings change only after a cut or a switch of level.

mod appearance;
mod bake;
mod base;
pub mod basis;
mod binder;
mod binding;
mod compositor;
pub mod culling;
mod cut;
mod draw;
mod gpu_culling;
mod level_of_detail;
mod map;
mod pick;
mod report;
mod skinned_vertices;
mod vertices;
mod walls;

pub use appearance::SkinColouring;
pub use bake::{BakeReport, bake};
pub use base::SkinBase;
pub use binding::{BaseMesh, BindingReport, Mapping};
pub use compositor::{Compositor, CompositorOptions};
pub use cut::SkinCut;
pub use draw::Skin;
pub use map::Map;
pub use pick::SkinPick;
pub use report::SkinReport;
pub use vertices::Vertices;
pub(crate) use walls::PendingWalls;
