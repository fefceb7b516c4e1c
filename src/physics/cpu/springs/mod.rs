//! Springs along edges: their energy term and its blocks.

pub(super) mod blocks;
pub(super) mod term;
