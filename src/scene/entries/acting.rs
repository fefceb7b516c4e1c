//! Entries of pressures, prescribed displacements and muscles.

use crate::scene::{LabelOrName, Region};
#[cfg(feature = "identify")]
use crate::{Error, Result, scene::Scene};
use serde::Deserialize;
use std::path::PathBuf;

/// Pressure on a patch of the boundary or of the interface between two regions. It acts along the
/// current face normals, evaluated at the start of each step, so it does not contribute to the
/// Hessian of implicit steps. Requires a tetrahedral body on the CPU engine.
///
/// ```toml
/// [[pressure]]
/// on = { axis = "z", above = 0.9 }   # faces with all nodes in it; default: the whole boundary
/// normal = [0.0, 0, 1]    # only faces within 45° of this normal at rest
/// # between = ["lung", "body"]        # or an interface: the first region presses on the second
/// pressure = 500.0        # Pa, inwards; or [[0.0, 0.0], [0.5, 500.0]]: time (s), pressure
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct PressureEntry {
    /// Region of the faces; all nodes of a face must lie in it.
    pub on: Option<Region>,
    /// Selects the faces whose normals at rest lie within 45° of this direction.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[0.0, 0.0, 1.0]])))]
    pub normal: Option<[f64; 3]>,
    /// Loads the interface of these two regions, by name or label, instead of the boundary: the
    /// first region presses on the second.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [["lung", "body"]])))]
    pub between: Option<[LabelOrName; 2]>,
    /// Pressure in Pa, positive inwards.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "Pa", "examples" = [500.0, [[0.0, 0.0], [0.5, 500.0]]])))]
    pub pressure: TimeSeries,
}

/// A constant, or a piecewise linear function of time as pairs of time in s and value.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "expected a number, or a list of [time, number]")]
#[allow(missing_docs)]
pub(crate) enum TimeSeries {
    Steady(f64),
    Keys(Vec<[f64; 2]>),
}

/// Prescribed displacement (Dirichlet condition) of nodes along a path. The nodes are on the path
/// at the end of each step and move at constant velocity within the step, which enters the damping.
/// Requires a tetrahedral body on the CPU engine.
///
/// ```toml
/// [[move]]
/// name = "jaw"            # in reaction files; default `move1`, `move2` …
/// on = { axis = "x", above = 0.95 }
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, 4]]   # time (s) and displacement
/// # file = "jaw.csv"      # or a table with the columns time_s,x,y,z
/// rotation = [[0.0, 0], [0.5, 30]]          # time (s) and angle (degrees) …
/// axis = [0.0, 1, 0]      # … about this axis
/// pivot = [0.0, 0, 0]     # through this point, which moves with the path; default: their centroid
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct MoveEntry {
    /// Name in reaction files.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["jaw"])))]
    pub name: Option<String>,
    /// The nodes.
    pub on: Region,
    /// Times and displacements from the rest position, interpolated linearly.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = [[[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 4.0]]])))]
    pub path: Option<Vec<[f64; 4]>>,
    /// CSV file with the path, relative to the scene file: a header `time_s,x,y,z` and numbers.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = ["jaw.csv"])))]
    pub file: Option<PathBuf>,
    /// Times and angles in degrees, interpolated linearly.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then degrees", "examples" = [[[0.0, 0.0], [0.5, 30.0]]])))]
    pub rotation: Option<Vec<[f64; 2]>>,
    /// Rotation axis.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.0, 0.0, 1.0], "examples" = [[0.0, 1.0, 0.0]])))]
    pub axis: Option<[f64; 3]>,
    /// Point on the rotation axis, at rest.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 0.0]])))]
    pub pivot: Option<[f64; 3]>,
}

/// A muscle: tetrahedra that contract along their fibres; see [`Muscle`](crate::physics::Muscle).
/// Requires finite elements on the CPU engine.
///
/// ```toml
/// [[muscle]]
/// region = "muscle"       # by name or label; default: the whole body
/// fibre = [0.0, 0, 1]     # or the name of a tet vector field; default: the longest axis
/// tension = 2e5           # active tension at full activation, Pa
/// activation = [[0.0, 0.0], [0.3, 1.0]]     # time (s), activation (0 to 1); or a number
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct MuscleEntry {
    /// The contracting region.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["muscle", 3])))]
    pub region: Option<LabelOrName>,
    /// Fibre direction at rest; default: the longest axis of the region.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[0.0, 0.0, 1.0], "fibre"])))]
    pub fibre: Option<FibreEntry>,
    /// Active tension T at full activation, Pa.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "Pa", "examples" = [2e5])))]
    pub tension: f64,
    /// Activation, from 0 to 1.
    #[cfg_attr(feature = "cli", schemars(extend("x-range" = "0 to 1", "examples" = [1.0, [[0.0, 0.0], [0.3, 1.0]]])))]
    pub activation: TimeSeries,
}

/// Fibre direction.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(
    untagged,
    expecting = "expected a direction [x, y, z], or the name of a vector field of the tets"
)]
pub(crate) enum FibreEntry {
    /// A uniform direction.
    Along([f64; 3]),
    /// Name of a vector field with one vector per tetrahedron.
    Field(String),
}

#[cfg(feature = "identify")]
impl Scene {
    /// Returns pressure `n` of the scene, Pa.
    ///
    /// # Errors
    /// [`Error::Input`] if it does not exist, or changes over time.
    pub(crate) fn steady_pressure(&self, n: usize) -> Result<f64> {
        match self.pressure.get(n).map(|entry| &entry.pressure) {
            Some(TimeSeries::Steady(pressure)) => Ok(*pressure),
            Some(TimeSeries::Keys(_)) => Err(Error::Input(format!(
                "pressure.{} changes over time; give it as one number ([[pressure]] pressure)",
                n + 1
            ))),
            None => Err(Error::Input(format!(
                "the scene has no pressure.{}; it has {} ([[pressure]])",
                n + 1,
                self.pressure.len()
            ))),
        }
    }

    /// Sets pressure `n` of the scene, Pa, if it exists.
    pub(crate) fn set_pressure(&mut self, n: usize, pascal: f64) {
        if let Some(entry) = self.pressure.get_mut(n) {
            entry.pressure = TimeSeries::Steady(pascal);
        }
    }
}
