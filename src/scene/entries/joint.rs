//! Entries of joints between rigid regions.

use crate::scene::LabelOrName;
use serde::Deserialize;

/// A joint between two rigid regions, including tools with a mass, or between one region and the
/// world at the rest position. Requires `engine = "rapier"`.
///
/// ```toml
/// [[joint]]
/// between = ["femur", "tibia"]    # or ["femur"], joined to the world
/// at = [0.0, 0, 410]      # in the mesh's unit
/// hinge = { axis = [1.0, 0, 0], limits = [-5.0, 120] }   # degrees; or one of these:
/// # slider = { axis = [0.0, 0, 1], limits = [0.0, 20] }   # in the mesh's unit
/// # ball = {}
/// # fixed = {}
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct JointEntry {
    /// The regions, by label or name: two, or one joined to the world.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [["femur", "tibia"], ["femur"]])))]
    pub between: Vec<LabelOrName>,
    /// Anchor point at rest.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 410.0]])))]
    pub at: [f64; 3],
    /// A hinge: rotation about an axis, limited to a range of angles in degrees.
    pub hinge: Option<AxisEntry>,
    /// A slider: translation along an axis, limited to a range in the mesh's unit.
    pub slider: Option<AxisEntry>,
    /// A ball joint: free rotation.
    pub ball: Option<EmptyEntry>,
    /// A fixed joint: no free degree of freedom.
    pub fixed: Option<EmptyEntry>,
}

/// Axis and range of motion of a joint.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct AxisEntry {
    /// Direction of the axis.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[1.0, 0.0, 0.0]])))]
    pub axis: [f64; 3],
    /// Lower limit (≤ 0) and upper limit (≥ 0).
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "degrees, or mesh unit", "examples" = [[-5.0, 120.0]])))]
    pub limits: Option<[f64; 2]>,
}

/// An entry without keys.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct EmptyEntry {}
