//! Entries of the bodies of a scene: the mesh, the particle grid and `[[body]]`.

use super::ForceEntry;
use crate::mesh::{AnatomicalFrame, Length};
use crate::mesher::ThresholdRange;
use crate::physics::EngineChoice;
use crate::scene::LabelOrName;
use crate::scene::keywords;
#[cfg(feature = "cli")]
use crate::scene::schema;
use crate::scene::{CageEntry, MaterialEntry, Region};
use crate::{Error, Result};
use serde::{Deserialize, Deserializer};
use std::path::PathBuf;
use std::str::FromStr;

/// Source of the mesh: a file or a generator. A volume or a closed surface is meshed first, as in
/// `palpate mesh`:
///
/// ```toml
/// [mesh]
/// file = "knee.nrrd"
/// labels = "all"                         # or [1, 2, 5]; or thresholds:
/// # above = ["skin=500", "bone=1150"]
/// # between = ["150..400"]
/// tets = 60000                           # or edge = "2mm"
/// ```
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MeshSource {
    /// A mesh file, in the folder of the scene file unless absolute.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["knee.nrrd", "liver.vtu"])))]
    pub file: Option<PathBuf>,
    /// The same mesh at rest, if `file` contains a deformed state and the scene is not simulated.
    /// Scans and planes given at rest use it. A vector field `displacement`, as in series, serves
    /// the same purpose.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["rest.vtu"])))]
    pub rest: Option<PathBuf>,
    /// Name of a generator, which makes a simple body, instead of a file.
    #[serde(default, deserialize_with = "keywords::generator")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::generator", extend("examples" = ["limb"])))]
    pub generate: Option<String>,
    /// Approximate number of tetrahedra of the generator or the mesher.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 1, "examples" = [60_000])))]
    pub tets: Option<usize>,
    /// Diameter of the lump in a generated organ, mm; 0 for no lump; default 15.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mm", "default" = 15.0, "minimum" = 0.0, "examples" = [20.0])))]
    pub lump_mm: Option<f64>,
    /// Depth of the lump below the surface, mm; default 10.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mm", "default" = 10.0, "minimum" = 0.0, "examples" = [15.0])))]
    pub depth_mm: Option<f64>,
    /// Ratio of the stiffness of the lump to that of the surrounding tissue, used by the material's
    /// `stiffness_field = "stiffness"`; default 5.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 5.0, "exclusiveMinimum" = 0.0, "examples" = [10.0])))]
    pub contrast: Option<f64>,
    /// Edge length at boundaries, instead of `tets`: `"2mm"`, or a number in the file's unit.
    #[serde(default, deserialize_with = "present")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::length", extend("x-unit" = "unit of the file, or stated", "examples" = ["2mm", 0.002])))]
    pub edge: Option<Length>,
    /// Labels of a volume that become regions: `"all"` or a list.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["all", [1, 2, 5]])))]
    pub(crate) labels: Option<LabelsEntry>,
    /// Which volume of a file of several (times, echoes, components) is meshed, counted from 0.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [2])))]
    pub volume: Option<usize>,
    /// Lower thresholds of the regions of a volume, each valid up to the next one: numbers or
    /// `"NAME=VALUE"`.
    #[serde(default, deserialize_with = "present_list")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::thresholds", extend("examples" = [["soft=500", "bone=1300"]])))]
    pub above: Vec<ThresholdRange>,
    /// Value ranges of a volume that become regions: `"LOW..HIGH"`, `"NAME=LOW..HIGH"`.
    #[serde(default, deserialize_with = "present_list")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::thresholds", extend("examples" = [["150..400", "fat=-150..-20"]])))]
    pub between: Vec<ThresholdRange>,
    /// Largest ratio of interior to boundary edge length.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 4.0, "minimum" = 1.0, "maximum" = 1024.0, "examples" = [8.0])))]
    pub grading: Option<f64>,
    /// Volume below which a connected component of a region is merged into its neighbour.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "cubed mesh unit", "default" = 0.0, "minimum" = 0.0, "examples" = [1000.0])))]
    pub min_island: Option<f64>,
    /// Pairs of regions, by name or label, whose common interface is split: each side gets its own
    /// nodes. A split ends where a third region connects the two.
    #[serde(default)]
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[["femoral cartilage", "patellar cartilage"]]])))]
    pub(crate) split: Vec<[LabelOrName; 2]>,
    /// Width of the gap opened at each split interface, in the mesh's unit. With `[contact]` the
    /// two sides then press and slide on each other.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "minimum" = 0.0, "examples" = [0.1])))]
    pub split_gap: Option<f64>,
    /// Other meshes of the same body, such as the second of two parts in contact.
    #[serde(default)]
    pub join: Vec<JoinEntry>,
    /// Length unit of the mesh: `m`, `cm`, `mm`, `um`, or metres as a number. Defaults to the unit
    /// in the mesh file, or else `m`.
    #[serde(default, deserialize_with = "keywords::unit")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::unit", extend("examples" = ["mm", 0.001])))]
    pub unit: Option<Unit>,
    /// Frame of reference of a file that does not state its own: `ras` or `lps`. Without it the
    /// coordinates are kept, and a surface that meets a scan is taken as LPS.
    #[serde(default, deserialize_with = "keywords::frame")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::frame", extend("examples" = ["ras"])))]
    pub frame: Option<AnatomicalFrame>,
}

/// Another mesh of the same body. Nodes are not merged, so the meshes interact only with
/// `[contact]`. Regions are renamed to `NAME/REGION`, those of the first mesh to `first/REGION`;
/// tissues match either word.
///
/// ```toml
/// [[mesh.join]]
/// name = "second"
/// generate = "limb"       # or file = "…"
/// tets = 20000
/// turn = 180              # degrees about the axis through the coordinate origin,
/// axis = [0.0, 0, 1]
/// offset = [0.7, 0, 0]    # applied after the rotation
/// ```
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct JoinEntry {
    /// Prefix of its region names; default `mesh2`, `mesh3` …
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["second"])))]
    pub name: Option<String>,
    /// A mesh file, in the folder of the scene file unless absolute.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["knee.nrrd", "liver.vtu"])))]
    pub file: Option<PathBuf>,
    /// Name of a generator, instead of a file.
    #[serde(default, deserialize_with = "keywords::generator")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::generator", extend("examples" = ["limb"])))]
    pub generate: Option<String>,
    /// Approximate number of tetrahedra of the generator.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 1, "examples" = [20_000])))]
    pub tets: Option<usize>,
    /// Rotation angle about `axis`, degrees.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "degrees", "default" = 0.0, "examples" = [180.0])))]
    pub turn: Option<f64>,
    /// Rotation axis; default +z.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.0, 0.0, 1.0], "examples" = [[0.0, 1.0, 0.0]])))]
    pub axis: Option<[f64; 3]>,
    /// Translation, in the unit of the first mesh.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "default" = [0.0, 0.0, 0.0], "examples" = [[0.7, 0.0, 0.0]])))]
    pub offset: Option<[f64; 3]>,
}

/// One of several bodies, with the entries of a scene of one body. Grabs, cuts, skins, the floor
/// and the picture are shared by all bodies. The bodies do not interact.
///
/// ```toml
/// [[body]]
/// name = "core"
/// mesh = { generate = "ball", tets = 4000 }
/// offset = [0.0, 0, 0.1]  # translation, in the unit of the first body's mesh (used by all)
/// material = { young = 1e6 }
/// engine = "cpu"
///
/// [[body.pin]]
/// axis = "z"
/// above = 0.9
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// Name in messages, reports and regions; default `body 1`, `body 2` …
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["core"])))]
    pub name: Option<String>,
    /// Source of the mesh.
    pub mesh: MeshSource,
    /// Translation, applied after the mesh is converted to the unit of the first body's mesh.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "default" = [0.0, 0.0, 0.0], "examples" = [[0.7, 0.0, 0.0]])))]
    pub offset: Option<[f64; 3]>,
    /// Material; default: the scene's `[material]`.
    pub material: Option<MaterialEntry>,
    /// Time integration scheme; default: `[solver] name`.
    #[serde(default, deserialize_with = "keywords::solver")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::solver", extend("examples" = ["verlet"])))]
    pub solver: Option<String>,
    /// Engine of the time steps; default: `[solver] engine`.
    #[serde(default, deserialize_with = "keywords::engine")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::engine", extend("examples" = ["cpu"])))]
    pub engine: Option<EngineChoice>,
    /// Largest time step, s; a longer `[solver] dt` is divided into substeps.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s", "exclusiveMinimum" = 0.0, "examples" = [0.001])))]
    pub dt: Option<f64>,
    /// Fixed nodes.
    #[serde(default)]
    pub(crate) pin: Vec<Region>,
    /// Forces on groups of nodes.
    #[serde(default)]
    pub(crate) force: Vec<ForceEntry>,
    /// Replaces the tetrahedra by a grid of particles.
    pub(crate) grid: Option<GridEntry>,
    /// Simulates a coarse cage in which the mesh is embedded, instead of the mesh.
    pub(crate) cage: Option<CageEntry>,
}

/// Label selection of a volume.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "labels must be \"all\" or a list of integers")]
#[allow(missing_docs)]
pub(crate) enum LabelsEntry {
    These(Vec<i64>),
    All(AllKeyword),
}

/// The word `all`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub(crate) enum AllKeyword {
    All,
}

/// A number or text.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or text")]
enum NumberOrText {
    Number(f64),
    Text(String),
}

impl NumberOrText {
    fn parse<T: FromStr<Err = Error>, E: serde::de::Error>(&self) -> std::result::Result<T, E> {
        let text = match self {
            NumberOrText::Number(number) => number.to_string(),
            NumberOrText::Text(text) => text.clone(),
        };
        text.parse().map_err(E::custom)
    }
}

pub(super) fn present<'de, T, D>(from: D) -> std::result::Result<Option<T>, D::Error>
where
    T: FromStr<Err = Error>,
    D: Deserializer<'de>,
{
    NumberOrText::deserialize(from)?.parse().map(Some)
}

pub(super) fn present_list<'de, T, D>(from: D) -> std::result::Result<Vec<T>, D::Error>
where
    T: FromStr<Err = Error>,
    D: Deserializer<'de>,
{
    let all = Vec::<NumberOrText>::deserialize(from)?;
    all.iter().map(NumberOrText::parse).collect()
}

/// A length unit by name or in metres.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(
    untagged,
    expecting = "unit must be m, cm, mm, um, in, or metres as a number"
)]
pub enum Unit {
    /// Metres in one unit.
    Metres(f64),
    /// `m`, `cm`, `mm`, `um`, `in`.
    Name(String),
}

impl Unit {
    /// Metres in one unit.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown name or a length that is not positive.
    pub fn metres(&self) -> Result<f64> {
        match self {
            Unit::Metres(m) if m.is_finite() && *m > 0.0 => Ok(*m),
            Unit::Metres(m) => Err(Error::Input(format!(
                "unit must be a positive number of metres, got {m}"
            ))),
            Unit::Name(name) => crate::mesh::metres_in(name).ok_or_else(|| {
                Error::Input(format!(
                    "unknown unit \"{name}\"; use m, cm, mm, um, in, or metres as a number"
                ))
            }),
        }
    }
}

/// A grid body: particles on a regular grid that fill the volume given by `[mesh]` (a volume with
/// labels or thresholds, a closed surface, or a tetrahedral mesh), each connected to 18 neighbours
/// by springs. It is stepped by `verlet`.
///
/// ```toml
/// [grid]
/// nodes = 20000           # or spacing = 2.0, or [1.0, 1.0, 1.5], in the file's unit
/// damping = 1.0           # mass-proportional damping rate, 1/s
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct GridEntry {
    /// Approximate number of particles; default 20,000.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 20_000, "minimum" = 1, "examples" = [50_000])))]
    pub nodes: Option<usize>,
    /// Grid spacing, instead of `nodes`: one length, or one per axis.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "unit of the file", "examples" = [2.0, [1.0, 1.0, 1.5]])))]
    pub spacing: Option<Lengths>,
    /// Damping rate, 1/s.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "1/s", "minimum" = 0.0, "examples" = [1.0])))]
    pub damping: Option<f64>,
    /// Distance outside a surface or mesh up to which particles are added, which connects disjoint
    /// components, such as bones.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "unit of the file", "default" = 0.0, "minimum" = 0.0, "examples" = [2.0])))]
    pub margin: Option<f64>,
}

/// One length, or one per axis.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "expected a length, or three lengths")]
#[allow(missing_docs)]
pub(crate) enum Lengths {
    Same(f64),
    Each([f64; 3]),
}
