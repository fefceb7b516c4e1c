//! Contact with tools and self-contact: tool shapes and poses, settings, and barrier and friction
//! potentials.
//!
//! The solver's part is in `physics/cpu/contact*.rs`.

mod barrier;
mod field;
mod own;
mod pair;
mod shape;
mod tool;

pub(super) use barrier::{Barrier, FrictionMollifier};
pub use field::DistanceField;
pub use own::SelfContactSettings;
#[cfg(test)]
pub(crate) use pair::pseudo_random_points;
pub(super) use pair::{MIN_DISTANCE_RATIO, PrimitivePair};
pub use shape::{Shape, SurfaceDistance};
pub use tool::{InitialPenetration, Tool, ToolId, ToolPose};
pub(super) use tool::{ToolMotion, check_pose};
