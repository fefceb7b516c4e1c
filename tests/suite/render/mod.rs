//! The raycaster against a float64 reference, on the software adapter.

#[allow(dead_code)]
mod common;
mod gaps;
mod geometry;
mod golden;
mod inside;
mod large;
mod light;
mod peeling;
mod picks;
mod pictures;
mod pieces;
mod planes;
mod projections;
mod recording;
mod regions;
mod scans;
mod sizes;
mod starts;
mod surface;
mod table;
mod thickness;
mod together;
