//! What acts on a body along its boundary, moves parts of it, and contracts it.

use crate::scene::{LabelOrName, Region};
use serde::Deserialize;
use std::path::PathBuf;

/// Pressure on a patch of the boundary, or of where two regions meet. It acts along the normals of its faces as they turn, those
/// at the start of each step: it has no part in the second derivatives of implicit steps. A body of
/// tets on the processor's engine.
///
/// ```toml
/// [[pressure]]
/// on = { axis = "z", above = 0.9 }   # faces with all nodes in it; the whole boundary without
/// facing = [0.0, 0, 1]    # of these, those that face within 45° of it at rest
/// # between = ["lung", "body"]        # in place of the boundary: the first region presses on the second
/// pascal = 500.0          # inwards; or [[0.0, 0.0], [0.5, 500.0]]: time in s and pressure
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PressureEntry {
    /// Where: faces all of whose nodes are in it.
    pub on: Option<Region>,
    /// Faces whose normals at rest lie within 45° of this direction.
    pub facing: Option<[f64; 3]>,
    /// Of the faces where these regions meet, by name or label, not of the boundary: the first presses
    /// on the second.
    pub between: Option<[LabelOrName; 2]>,
    /// The pressure in Pa, positive inwards.
    pub pascal: TimeSeries,
}

/// A number, or its course in time: times in s and numbers, linear between them.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(
    untagged,
    expecting = "a number, or a list of [time, number], is expected"
)]
#[allow(missing_docs)]
pub enum TimeSeries {
    Steady(f64),
    Keys(Vec<[f64; 2]>),
}

/// Nodes that are moved along a path: where it takes them, whatever pulls at them. They are where
/// the path says at the end of each step, and go there at an even velocity, which damping feels. A
/// body of tets on the processor's engine.
///
/// ```toml
/// [[move]]
/// name = "jaw"            # in files of reactions; `move1` and so on where nothing is said
/// on = { axis = "x", above = 0.95 }
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, 4]]   # time in s, and how far they have moved
/// # file = "jaw.csv"      # or a table with the columns time_s,x,y,z
/// turn = [[0.0, 0], [0.5, 30]]              # time in s, and degrees …
/// axis = [0.0, 1, 0]      # … about this axis …
/// about = [0.0, 0, 0]     # … through this point, which moves along; their middle where none is said
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveEntry {
    /// What it is called in files of reactions.
    pub name: Option<String>,
    /// Which nodes.
    pub on: Region,
    /// Times and displacements from where they rest, linear between them.
    pub path: Option<Vec<[f64; 4]>>,
    /// A CSV file of the same, beside the scene file: a header `time_s,x,y,z` and numbers.
    pub file: Option<PathBuf>,
    /// Times and angles in degrees, linear between them.
    pub turn: Option<Vec<[f64; 2]>>,
    /// What they turn about.
    pub axis: Option<[f64; 3]>,
    /// A point of that axis where the nodes rest.
    pub about: Option<[f64; 3]>,
}

/// A muscle: tets that contract along their fibres; see [`Muscle`](crate::physics::Muscle). A body
/// of finite elements on the processor's engine.
///
/// ```toml
/// [[muscle]]
/// region = "muscle"       # by name or label; the whole body where nothing is said
/// fibre = [0.0, 0, 1]     # or the name of a vector field of the tets; along the region where none
/// tension = 2e5           # Pa, at full activation
/// activation = [[0.0, 0.0], [0.3, 1.0]]     # time in s, and from 0 to 1; or a number
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MuscleEntry {
    /// The region that contracts.
    pub region: Option<LabelOrName>,
    /// The direction of its fibres at rest; the way the region is longest where nothing is said.
    pub fibre: Option<FibreEntry>,
    /// T, Pa.
    pub tension: f64,
    /// From 0 to 1.
    pub activation: TimeSeries,
}

/// The direction of fibres.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(
    untagged,
    expecting = "a direction [x, y, z], or the name of a vector field of the tets, is expected"
)]
pub enum FibreEntry {
    /// The same everywhere.
    Along([f64; 3]),
    /// A vector a tet, by the field's name.
    Field(String),
}
