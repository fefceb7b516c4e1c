//! The raycaster against float64 truth, on the software adapter.
#![allow(clippy::unwrap_used)]

#[allow(dead_code)]
mod common;
mod pictures;
