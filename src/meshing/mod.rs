//! `palpate mesh`: files of scans and surfaces to meshes with named regions.
//!
//! A [`MeshingConfig`] names the input and its regions; [`mesher`](crate::mesher) or the program
//! TetGen meshes them.

mod domain_source;
mod recipe;
mod size_field;
#[cfg_attr(target_arch = "wasm32", path = "tetgen_absent.rs")]
mod tetgen;

pub use recipe::{
    Labels, MeshingConfig, MeshingResult, RecipeReport, RegionSummary, TargetSize, mesh_file,
};
pub use tetgen::tetgen;
