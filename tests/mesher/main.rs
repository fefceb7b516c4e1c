//! The mesher, held to the truth.
#![allow(clippy::unwrap_used)]

mod solids;
mod support;
