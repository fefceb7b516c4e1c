//! Joints between rigid regions.

use crate::scene::LabelOrName;
use serde::Deserialize;

/// A joint between two rigid regions, tools with a mass among them, or of one to the world, where the
/// body rests. With `engine = "rapier"`.
///
/// ```toml
/// [[joint]]
/// between = ["femur", "tibia"]    # or ["femur"], which is joined to the world
/// at = [0.0, 0, 410]      # in the mesh's unit
/// hinge = { axis = [1.0, 0, 0], limits = [-5.0, 120] }    # degrees that the second turns; or one of these:
/// # slider = { axis = [0.0, 0, 1], limits = [0.0, 20] }   # in the mesh's unit
/// # ball = {}
/// # fixed = {}
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointEntry {
    /// The regions, by label or name.
    pub between: Vec<LabelOrName>,
    /// Where it is at rest.
    pub at: [f64; 3],
    /// Leaves turns about an axis free, between two angles in degrees.
    pub hinge: Option<AxisEntry>,
    /// Leaves ways along an axis free, between two lengths in the mesh's unit.
    pub slider: Option<AxisEntry>,
    /// Leaves all turns free.
    pub ball: Option<EmptyEntry>,
    /// Leaves nothing free.
    pub fixed: Option<EmptyEntry>,
}

/// An axis, and how far what is joined goes about or along it.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisEntry {
    /// Its direction.
    pub axis: [f64; 3],
    /// From, 0 at most, and to, 0 at least.
    pub limits: Option<[f64; 2]>,
}

/// Nothing more to say.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmptyEntry {}
