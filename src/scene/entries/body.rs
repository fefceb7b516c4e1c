//! What a body is: its mesh, its grid, and several of them.

use super::ForceEntry;
use crate::mesher::{Length, ThresholdRange};
use crate::physics::EngineChoice;
use crate::scene::LabelOrName;
use crate::scene::keywords;
use crate::scene::{CageEntry, MaterialEntry, Region};
use crate::{Error, Result};
use serde::{Deserialize, Deserializer};
use std::path::PathBuf;
use std::str::FromStr;

/// Where the mesh comes from: a file, or a generator. A volume or a closed surface is meshed
/// first, as `palpate mesh` does:
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
#[serde(deny_unknown_fields)]
pub struct MeshSource {
    /// A mesh file, beside the scene file unless absolute.
    pub file: Option<PathBuf>,
    /// The same mesh at rest, where `file` has it deformed and nothing moves it: scans and planes that
    /// are given at rest go by it. A field `displacement`, as series have it, serves as well.
    pub rest: Option<PathBuf>,
    /// A generator's name, instead of a file; see [`crate::mesh::generate::GENERATORS`].
    #[serde(default, deserialize_with = "keywords::generator")]
    pub generate: Option<String>,
    /// About how many tets the generator or the mesher makes.
    pub tets: Option<usize>,
    /// Diameter of the lump in an organ that is generated, mm; 0 for none. 15 where nothing is said.
    pub lump_mm: Option<f64>,
    /// How far the lump is below the surface, mm; 10 where nothing is said.
    pub depth_mm: Option<f64>,
    /// How many times as stiff the lump is as what it lies in, for the material's
    /// `stiffness_field = "stiffness"`; 5 where nothing is said.
    pub contrast: Option<f64>,
    /// Edge length at boundaries, instead of `tets`: `"2mm"`, or a number in the file's unit.
    #[serde(default, deserialize_with = "present")]
    pub edge: Option<Length>,
    /// Which labels of a volume are regions: `"all"`, or a list.
    pub labels: Option<LabelsEntry>,
    /// Thresholds from which on a volume's values are a region, each up to the next: numbers, or
    /// `"NAME=VALUE"`.
    #[serde(default, deserialize_with = "present_list")]
    pub above: Vec<ThresholdRange>,
    /// Ranges of a volume's values that are a region: `"LOW..HIGH"`, `"NAME=LOW..HIGH"`.
    #[serde(default, deserialize_with = "present_list")]
    pub between: Vec<ThresholdRange>,
    /// Times by which edges may be longer away from boundaries.
    pub grading: Option<f64>,
    /// Pieces of regions of less volume are given to what surrounds them.
    pub min_island: Option<f64>,
    /// Pairs of regions that are parted where they meet, by name or label: each gets nodes of its
    /// own there. A seam ends where a third region holds the two together.
    #[serde(default)]
    pub part: Vec<[LabelOrName; 2]>,
    /// How far the two sides of each such seam are drawn apart, in the mesh's unit: with `[contact]`
    /// they press on each other then, and glide.
    pub part_gap: Option<f64>,
    /// Other meshes that are of the same body, such as the second of two that touch.
    #[serde(default)]
    pub join: Vec<JoinEntry>,
    /// What one unit of the mesh is: `m`, `cm`, `mm`, `um`, or a number of metres; what the mesh
    /// file says by default, or else `m`.
    #[serde(default, deserialize_with = "keywords::unit")]
    pub unit: Option<Unit>,
}

/// Another mesh of the same body: nothing grows together, so that it takes `[contact]` for the two to
/// feel each other. Regions are named `NAME/REGION` then, those of the first mesh `first/REGION`;
/// tissues are found by either word.
///
/// ```toml
/// [[mesh.join]]
/// name = "second"
/// generate = "limb"       # or file = "…"
/// tets = 20000
/// turn = 180              # degrees about the axis through its coordinates' origin …
/// axis = [0.0, 0, 1]
/// offset = [0.7, 0, 0]    # … and then moved
/// ```
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JoinEntry {
    /// What its regions are named after; `mesh2` and so on where nothing is said.
    pub name: Option<String>,
    /// A mesh file, beside the scene file unless absolute.
    pub file: Option<PathBuf>,
    /// A generator's name, instead of a file.
    #[serde(default, deserialize_with = "keywords::generator")]
    pub generate: Option<String>,
    /// About how many tets the generator makes.
    pub tets: Option<usize>,
    /// Degrees by which it is turned about `axis`.
    pub turn: Option<f64>,
    /// What it is turned about; +z where nothing is said.
    pub axis: Option<[f64; 3]>,
    /// By how much it is moved, in the unit of the first mesh.
    pub offset: Option<[f64; 3]>,
}

/// One of several bodies. Each has what a scene of one would have; grabs, cuts, skins, the floor and
/// the picture are those of all. They do not feel each other.
///
/// ```toml
/// [[body]]
/// name = "core"
/// mesh = { generate = "ball", tets = 4000 }
/// offset = [0.0, 0, 0.1]  # moves it, in the unit of the first body's mesh, which is that of all
/// material = { young = 1e6 }
/// engine = "cpu"
///
/// [[body.pin]]
/// axis = "z"
/// above = 0.9
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// What it is called in messages, reports and regions; `body 1` and so on where nothing is said.
    pub name: Option<String>,
    /// Where its mesh comes from.
    pub mesh: MeshSource,
    /// How far it is moved, after its mesh was brought to the unit of the first body's.
    pub offset: Option<[f64; 3]>,
    /// What it is made of; the scene's `[material]` where nothing is said.
    pub material: Option<MaterialEntry>,
    /// By which scheme it is stepped; `[solver] name` where nothing is said.
    #[serde(default, deserialize_with = "keywords::solver")]
    pub solver: Option<String>,
    /// What computes its steps; `[solver] engine` where nothing is said.
    #[serde(default, deserialize_with = "keywords::engine")]
    pub engine: Option<EngineChoice>,
    /// Its largest step, in seconds: a longer one of `[solver] dt` is made of several.
    pub dt: Option<f64>,
    /// Nodes that stay where they are.
    #[serde(default)]
    pub pin: Vec<Region>,
    /// Forces on groups of nodes.
    #[serde(default)]
    pub force: Vec<ForceEntry>,
    /// Makes it a grid of particles in place of tets.
    pub grid: Option<GridEntry>,
    /// Simulates a coarse body in place of its mesh, which that carries.
    pub cage: Option<CageEntry>,
}

/// Labels of a volume.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "labels are \"all\" or a list of whole numbers")]
#[allow(missing_docs)]
pub enum LabelsEntry {
    These(Vec<i64>),
    All(AllKeyword),
}

/// The word `all`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum AllKeyword {
    All,
}

/// A number, or text.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a number or text is expected")]
enum Said {
    Number(f64),
    Text(String),
}

impl Said {
    fn parse<T: FromStr<Err = Error>, E: serde::de::Error>(&self) -> std::result::Result<T, E> {
        let text = match self {
            Said::Number(number) => number.to_string(),
            Said::Text(text) => text.clone(),
        };
        text.parse().map_err(E::custom)
    }
}

pub(super) fn present<'de, T, D>(from: D) -> std::result::Result<Option<T>, D::Error>
where
    T: FromStr<Err = Error>,
    D: Deserializer<'de>,
{
    Said::deserialize(from)?.parse().map(Some)
}

pub(super) fn present_list<'de, T, D>(from: D) -> std::result::Result<Vec<T>, D::Error>
where
    T: FromStr<Err = Error>,
    D: Deserializer<'de>,
{
    let all = Vec::<Said>::deserialize(from)?;
    all.iter().map(Said::parse).collect()
}

/// A length unit by name or in metres.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(
    untagged,
    expecting = "a unit is one of m, cm, mm, um and in, or metres as a number"
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
                "unit = {m}: metres in one unit of the mesh, a positive number, are expected"
            ))),
            Unit::Name(name) => crate::mesher::metres_in(name).ok_or_else(|| {
                Error::Input(format!(
                    "unit \"{name}\" is not known; use m, cm, mm, um, in, or metres as a number"
                ))
            }),
        }
    }
}

/// A grid body: particles on a regular grid, carved out of what `[mesh]` names (a volume by its
/// labels or thresholds, a closed surface, a tet mesh), with springs to 18 neighbours each. It is
/// stepped by `verlet`.
///
/// ```toml
/// [grid]
/// nodes = 20000           # or spacing = 2.0, or [1.0, 1.0, 1.5], in the file's unit
/// damping = 1.0           # every particle is braked by this rate, 1/s
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridEntry {
    /// About how many particles; 20,000 where nothing is said.
    pub nodes: Option<usize>,
    /// Distance between particles, instead of `nodes`: one length, or one for each axis.
    pub spacing: Option<Lengths>,
    /// Rate of damping, 1/s.
    pub damping: Option<f64>,
    /// Particles lie up to this far outside a surface or mesh too, so that a body holds pieces
    /// together that do not touch: bones, for example.
    pub margin: Option<f64>,
}

/// One length, or one for each axis.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "a length, or three of them, are expected")]
#[allow(missing_docs)]
pub enum Lengths {
    Same(f64),
    Each([f64; 3]),
}
