//! Springs along edges: their energy term and its blocks.

pub(super) mod blocks;
mod tangent;
pub(super) mod term;
