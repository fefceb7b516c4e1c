//! Contact with tools and self-contact: tool shapes and poses, settings, and barrier and friction
//! potentials.
//!
//! The solver's part is in `physics/cpu/contact*.rs`.

mod barrier;
mod primitive_pair;
mod sdf;
mod self_contact_settings;
mod shape;
mod tool;
mod tool_check;

pub(super) use barrier::{Barrier, FrictionMollifier};
#[cfg(test)]
pub(crate) use primitive_pair::pseudo_random_points;
pub(super) use primitive_pair::{MIN_DISTANCE_RATIO, PrimitivePair};
pub use sdf::DistanceField;
pub use self_contact_settings::SelfContactSettings;
pub use shape::Shape;
pub(crate) use shape::SurfaceDistance;
pub(crate) use tool::Penetration;
pub use tool::{Tool, ToolId, ToolPose};
pub(super) use tool::{ToolMotion, check_pose};
