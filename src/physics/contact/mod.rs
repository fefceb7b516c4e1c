//! Contact: tools that press on a body, their shapes and where they are, and the potentials by
//! which nothing passes through them.
//!
//! The engine's side is in `physics/cpu/contact*.rs`.

mod barrier;
mod field;
mod own;
mod pair;
mod shape;
mod tool;

pub(super) use barrier::{Barrier, Slip};
pub use field::DistanceField;
pub use own::SelfContact;
#[cfg(test)]
pub(crate) use pair::scattered;
pub(super) use pair::{Features, KEPT};
pub use shape::{Shape, Touch};
pub use tool::{Overlap, Tool, ToolId, ToolPose};
pub(super) use tool::{ToolPath, check_pose};
