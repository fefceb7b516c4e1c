//! Meshes: topology, quality, description and repairs.

mod cuts;
mod data;
mod describe;
mod distance;
mod isosurface;
mod quality;
mod repairs;
pub mod support;
mod surfaces;
mod topology;
