//! Skins: detailed surfaces carried by the nodes of a less detailed body.
//!
//! After Mosegaard & Sørensen, *Real-time Deformation of Detailed Geometry Based on Mappings to a
//! Less Detailed Physical Simulation on the GPU* (2005). Every vertex is bound once, on the CPU,
//! to three nodes of the body; the vertex shader does the rest from the texture of positions.
//! Nothing is read back, and what a vertex is made of never changes.

mod bake;
pub mod basis;
mod binder;
mod binding;
mod carrier;
mod composer;
mod cull;
pub mod culling;
mod cut;
mod draw;
mod levels;
mod look;
mod map;
mod pick;
mod placed;
mod report;
mod vertices;

pub use bake::{BakeReport, bake};
pub use binding::{BaseMesh, BindingReport, Mapping, bind};
pub use carrier::SkinBase;
pub use composer::{Compositor, CompositorOptions};
pub use cut::SkinCut;
pub use draw::Skin;
pub use look::SkinColouring;
pub use map::Map;
pub use pick::SkinPick;
pub use report::SkinReport;
pub use vertices::Vertices;
