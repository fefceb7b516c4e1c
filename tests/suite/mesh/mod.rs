//! Meshes: generators, topology, quality, description and repairs.

mod cuts;
mod data;
mod describe;
mod distance;
mod foot;
mod generators;
mod isosurface;
mod limb;
mod quality;
mod repairs;
mod support;
mod surfaces;
mod topology;
