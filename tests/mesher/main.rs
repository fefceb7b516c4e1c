//! The mesher, held to the truth.
#![allow(clippy::unwrap_used)]

mod labels;
mod scans;
mod solids;
mod support;
mod tetgen;
