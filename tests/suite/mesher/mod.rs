//! The mesher, held to the truth.

mod labels;
mod scans;
mod solids;
mod support;
mod tetgen;
