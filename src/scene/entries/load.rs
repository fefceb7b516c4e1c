//! What acts on a body, and what it carries.

use super::body::present_list;
use crate::mesh::TriMesh;
use crate::mesher::ThresholdRange;
use crate::scene::keywords;
use crate::scene::{Preloaded, Region};
use crate::skin::Mapping;
use serde::Deserialize;
use std::path::PathBuf;

/// A force shared by the nodes of a region.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// Which nodes.
    pub on: Region,
    /// The sum of the forces on them, in N.
    pub total: [f64; 3],
}

/// A floor: a plane below which the nodes of a body of tets are pushed back. A body above a floor
/// is held by nothing but its pins.
///
/// ```toml
/// [floor]
/// point = [0.0, 0, -0.2]  # on it, in the mesh's unit
/// normal = [0.0, 0, 1]    # out of it
/// rate = 1000.0           # how hard it pushes: a node alone would swing so fast, 1/s
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorEntry {
    /// A point of it.
    pub point: [f64; 3],
    /// The direction out of it; +z where nothing is said.
    pub normal: Option<[f64; 3]>,
    /// How hard it pushes, 1/s.
    pub rate: Option<f64>,
}

/// A grab: nodes around a place follow a target along a path.
///
/// ```toml
/// [[grab]]
/// at = [0.0, 0.0, 10.0]   # in the mesh's unit; nodes within `radius` of it are grabbed
/// radius = 2.0
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, 4]]   # time in s, and how far from `at` the target is
/// release = 1.0           # s
/// # spring = 50.0         # N/m of all springs together; without, the nodes follow exactly
/// # limit = 2.0           # N, the largest force of the springs
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrabEntry {
    /// What it is called in files of reactions: `grab1` and so on where nothing is said.
    pub name: Option<String>,
    /// The middle of what is grabbed.
    pub at: [f64; 3],
    /// Nodes nearer than this are grabbed.
    pub radius: f64,
    /// Times and displacements of the target, linear between them.
    pub path: Vec<[f64; 4]>,
    /// When it lets go; never where nothing is said. It takes hold at the path's first time.
    pub release: Option<f64>,
    /// Stiffness of springs to the target.
    pub spring: Option<f64>,
    /// Their largest force.
    pub limit: Option<f64>,
}

/// A cut: the straight edge of a blade moves along a path, and opens what it sweeps over. On a
/// grid body it erases springs, on tets it opens faces and doubles nodes.
///
/// ```toml
/// [[cut]]
/// edge = [[0.0, 0, -9], [0.0, 0, 9]]        # the ends of the blade's edge, in the mesh's unit
/// path = [[0.2, 0, 5, 0], [0.6, 0, -5, 0]]  # time in s, and how far the edge has moved
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CutEntry {
    /// The ends of the blade's edge.
    pub edge: [[f64; 3]; 2],
    /// Times and displacements of the edge, linear between them: at least two.
    pub path: Vec<[f64; 4]>,
}

/// A skin: a detailed surface that the body carries. It lies in the mesh's unit, where the body
/// is at rest.
///
/// ```toml
/// [[skin]]
/// file = "skin.obj"       # .obj, .ply, .stl, .vtk; or a volume, with `above` or `labels`
/// mapping = "auto"        # or one-to-one, constant, interpolated, normal-only
/// opacity = 0.5
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkinEntry {
    /// A surface file beside the scene file, or a volume whose isosurface it is.
    pub file: PathBuf,
    /// Of a volume: the threshold of the isosurface.
    #[serde(default, deserialize_with = "present_list")]
    pub above: Vec<ThresholdRange>,
    /// Of a volume: the labels whose boundary it is.
    pub labels: Option<Vec<i64>>,
    /// Rounds of smoothing.
    pub smooth: Option<u32>,
    /// How the nodes carry it; chosen for each vertex where nothing is said.
    pub mapping: Option<Mapping>,
    /// Its colour: red, green, blue, from 0 to 1.
    pub colour: Option<[f32; 3]>,
    /// The colour of the walls that cuts lay bare, in mode `skin`; dark red where nothing is said.
    pub wall: Option<[f32; 3]>,
    /// A scalar of its vertices that colours it instead.
    pub field: Option<String>,
    /// The preset whose colours that scalar takes; `viridis` where nothing is said.
    #[serde(default, deserialize_with = "keywords::preset")]
    pub transfer: Option<String>,
    /// From 0, invisible, to 1, opaque.
    pub opacity: Option<f32>,
    /// A PNG of tangent-space normals, by texture coordinates.
    pub normal_map: Option<PathBuf>,
    /// A PNG of heights, by texture coordinates.
    pub height_map: Option<PathBuf>,
    /// How deep the height map is, in texture coordinates.
    pub height: Option<f32>,
    /// Whether it is left out of pictures.
    #[serde(default)]
    pub hidden: bool,
    /// Its surface, where it was read already.
    #[serde(skip)]
    pub surface: Preloaded<TriMesh>,
}
