//! Meshes: generators, topology, quality, description and repairs.
#![allow(clippy::unwrap_used)]

mod generators;
mod quality;
mod support;
