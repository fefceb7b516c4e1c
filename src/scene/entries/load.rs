//! Entries of forces, the floor, grabs, cuts and embedded surfaces (skins).

use super::body::present_list;
use crate::mesh::{AnatomicalFrame, TriMesh};
use crate::mesher::ThresholdRange;
use crate::scene::keywords;
#[cfg(feature = "cli")]
use crate::scene::schema;
use crate::scene::{Preloaded, Region};
use crate::skin::Mapping;
use serde::Deserialize;
use std::path::PathBuf;

/// A force on a region: an even traction on the boundary faces of the body whose nodes are in it; if
/// there are none, on the edges of the boundary in it, or else the same force on each node.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ForceEntry {
    /// The nodes.
    pub on: Region,
    /// Resultant force, N.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N", "examples" = [[0.0, 0.0, -2.0]])))]
    pub total: [f64; 3],
}

/// A mass that moves with a region of the body, such as a weight hung from it: distributed like the
/// force of a [`ForceEntry`].
///
/// ```toml
/// [[mass]]
/// on = { axis = "x", above = 0.99 }
/// kg = 0.052
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MassEntry {
    /// The nodes.
    pub on: Region,
    /// Mass, kg.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "kg", "minimum" = 0.0, "examples" = [0.052])))]
    pub kg: f64,
}

/// A floor: a plane with a penalty force on the nodes of a tetrahedral body below it. A body above
/// a floor has no supports other than its pins.
///
/// ```toml
/// [floor]
/// point = [0.0, 0, -0.2]  # a point on it, in the mesh's unit
/// normal = [0.0, 0, 1]    # outwards
/// stiffness_rate = 1000.0 # contact stiffness, as the frequency of a free node on it, 1/s
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct FloorEntry {
    /// A point on the plane.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, -0.2]])))]
    pub point: [f64; 3],
    /// Outward normal; default +z.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.0, 0.0, 1.0], "examples" = [[0.0, 1.0, 0.0]])))]
    pub normal: Option<[f64; 3]>,
    /// Contact stiffness as a frequency, 1/s.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "1/s", "default" = 1000.0, "exclusiveMinimum" = 0.0, "examples" = [500.0])))]
    pub stiffness_rate: Option<f64>,
}

/// A grab: the nodes near a point follow a target along a path.
///
/// ```toml
/// [[grab]]
/// at = [0.0, 0.0, 10.0]   # in the mesh's unit; nodes within `radius` are grabbed
/// radius = 2.0
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, 4]]   # time (s) and displacement of the target from `at`
/// release_time = 1.0      # s
/// # spring_stiffness = 50.0   # total, N/m; default: prescribed displacement
/// # max_force = 2.0       # largest spring force, N
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct GrabEntry {
    /// Name in reaction files; default `grab1`, `grab2` …
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["hand"])))]
    pub name: Option<String>,
    /// Centre of the grabbed sphere.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 10.0]])))]
    pub at: [f64; 3],
    /// Radius of the grabbed sphere.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [2.0])))]
    pub radius: f64,
    /// Times and displacements of the target, interpolated linearly.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = [[[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 4.0]]])))]
    pub path: Vec<[f64; 4]>,
    /// Release time, s; default: never. The grab starts at the first time of the path.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s", "examples" = [1.0])))]
    pub release_time: Option<f64>,
    /// Total stiffness of the springs to the target, N/m.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N/m", "exclusiveMinimum" = 0.0, "examples" = [500.0])))]
    pub spring_stiffness: Option<f64>,
    /// Largest force of the springs, N.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N", "exclusiveMinimum" = 0.0, "examples" = [2.0])))]
    pub max_force: Option<f64>,
}

/// A cut: the straight edge of a blade moves along a path and cuts what it sweeps. In a grid body
/// it removes springs; in a tetrahedral mesh it splits faces and duplicates nodes.
///
/// ```toml
/// [[cut]]
/// edge = [[0.0, 0, -9], [0.0, 0, 9]]        # the ends of the blade's edge, in the mesh's unit
/// path = [[0.2, 0, 5, 0], [0.6, 0, -5, 0]]  # time (s) and displacement of the edge
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct CutEntry {
    /// End points of the blade's edge.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[[0.0, 0.0, -9.0], [0.0, 0.0, 9.0]]])))]
    pub edge: [[f64; 3]; 2],
    /// Times and displacements of the edge, interpolated linearly; at least two.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = [[[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 4.0]]])))]
    pub path: Vec<[f64; 4]>,
}

/// A skin: a detailed surface embedded in the body. It is given in the mesh's unit and at the
/// body's rest position.
///
/// ```toml
/// [[skin]]
/// file = "skin.obj"       # .obj, .ply, .stl, .vtk; or a volume, with `above` or `labels`
/// mapping = "auto"        # or one-to-one, constant, interpolated, normal-only
/// opacity = 0.5
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SkinEntry {
    /// A surface file relative to the scene file, or a volume from which an isosurface is
    /// extracted.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["skin.obj"])))]
    pub file: PathBuf,
    /// Threshold of the isosurface of a volume.
    #[serde(default, deserialize_with = "present_list")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::thresholds", extend("examples" = [[1300]])))]
    pub above: Vec<ThresholdRange>,
    /// Labels of a volume whose boundary is extracted.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[1, 2]])))]
    pub labels: Option<Vec<i64>>,
    /// Frame of reference of a surface file that does not state its own: `ras` or `lps`. Without it
    /// the coordinates are kept, or taken as LPS on a body of known frame.
    #[serde(default, deserialize_with = "keywords::frame")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::frame", extend("examples" = ["ras"])))]
    pub frame: Option<AnatomicalFrame>,
    /// Number of smoothing iterations.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0, "examples" = [5])))]
    pub smooth: Option<u32>,
    /// How vertices are embedded in the mesh; by default chosen for each vertex.
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::mapping", extend("default" = "auto", "examples" = ["interpolated"])))]
    pub mapping: Option<Mapping>,
    /// Colour: red, green, blue, from 0 to 1.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[0.7, 0.75, 0.8]])))]
    pub colour: Option<[f32; 3]>,
    /// Colour of the walls of cuts in mode `skin`; default dark red.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.55, 0.12, 0.12], "examples" = [[0.5, 0.1, 0.1]])))]
    pub cut_colour: Option<[f32; 3]>,
    /// Scalar field of the vertices that replaces the colour.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["thickness"])))]
    pub field: Option<String>,
    /// Colour preset of that field; default `viridis`.
    #[serde(default, deserialize_with = "keywords::preset")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::preset", extend("default" = "viridis", "examples" = ["magma"])))]
    pub transfer: Option<String>,
    /// Opacity, from 0 (invisible) to 1 (opaque).
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.0, "maximum" = 1.0, "examples" = [0.6])))]
    pub opacity: Option<f32>,
    /// PNG of tangent-space normals, addressed by texture coordinates.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["normals.png"])))]
    pub normal_map: Option<PathBuf>,
    /// PNG of heights, addressed by texture coordinates.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["heights.png"])))]
    pub height_map: Option<PathBuf>,
    /// Depth of the height map, in texture coordinates.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "texture coordinates", "default" = 0.02, "examples" = [0.01])))]
    pub height: Option<f32>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
    /// The surface, if it was loaded already.
    #[serde(skip)]
    pub surface: Preloaded<TriMesh>,
}
