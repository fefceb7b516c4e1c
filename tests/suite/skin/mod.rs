//! Skins against their float64 reference, at rest, moved, bent, and in pictures.

mod bake;
mod common;
mod culling;
mod cuts;
mod levels;
mod mapping;
mod picks;
mod pictures;
mod recording;
mod twin;
