//! Mesh generators, one file per shape.
//!
//! All meshes are deterministic, positively oriented and connected, and have a closed boundary
//! without non-manifold edges.

mod ball;
mod bar;
mod benchmark;
mod biceps;
mod breast;
mod duct;
mod foot;
mod grid;
mod lattice_fill;
mod limb;
mod liver;
mod lump;
mod named;
mod shapes;

pub use ball::ball;
pub(crate) use bar::PAPER_BAR_SIZE;
pub use bar::{bar, bar_of_about, paper_bar};
pub use benchmark::benchmark_cube;
pub use biceps::biceps;
pub use breast::breast;
pub use duct::{Bore, duct};
pub use foot::{foot, foot_bones};
#[cfg(feature = "study")]
pub(crate) use grid::FIVE;
pub(crate) use grid::{Grid, grid};
pub use grid::{Split, box_mesh};
pub use limb::{TISSUES, Tissue, limb};
pub use liver::liver;
pub use lump::Lump;
#[cfg(all(feature = "study", feature = "identify"))]
pub(crate) use lump::middle_of_lump;
pub use named::{GENERATORS, by_name};
pub(crate) use named::{by_name_with_progress, check_name, has_lump};
