//! Contact: tools that press on a body, their shapes and where they are, and the potentials by
//! which nothing passes through them.
//!
//! The engine's side is in `physics/cpu/contact/`.

mod barrier;
mod primitive_pair;
mod sdf;
mod self_contact_settings;
mod shape;
mod tool;

pub(super) use barrier::{Barrier, FrictionMollifier};
#[cfg(test)]
pub(crate) use primitive_pair::pseudo_random_points;
pub(super) use primitive_pair::{MIN_DISTANCE_RATIO, PrimitivePair};
pub use sdf::DistanceField;
pub use self_contact_settings::SelfContactSettings;
pub use shape::{Shape, SurfaceDistance};
pub use tool::{InitialPenetration, Tool, ToolId, ToolPose};
pub(super) use tool::{ToolMotion, check_pose};
