//! A scene: a TOML file that names a mesh, a material, a solver, what holds and what pulls, a
//! camera, a transfer function and a picture. Everything has a default but the mesh; a scene of
//! several bodies has a [`BodyEntry`] for each.
//!
//! ```toml
//! [mesh]
//! file = "liver.vtu"      # beside the scene file; or generate = "limb", tets = 100000
//! unit = "mm"             # what one unit of the mesh is; physics needs to know
//!
//! [material]
//! young = 2e4             # Pa; or stiffness = 3000 (N/m, every spring alike)
//! bone = ["femur", 6]     # regions made of a tissue, by name or label: published values
//!
//! [solver]
//! name = "implicit"
//! dt = 0.01               # s
//! steps = 100
//!
//! [[pin]]                 # nodes that stay where they are
//! axis = "z"
//! below = 0.05            # the lowest 5 % of the bounds; or z_below = -0.6, in the mesh's unit
//!
//! [[force]]
//! on = { axis = "z", above = 0.95 }
//! total = [0.0, -2.0, 0.0]  # N, shared by the nodes of the region
//!
//! [picture]
//! field = "intensity"
//! transfer = "muscle"
//! size = [1024, 768]
//! ```

mod attachment;
mod bodies;
mod cage;
mod checkpoint;
mod cutter;
mod grid;
mod load;
mod material;
mod measure;
mod motion;
mod path;
mod picture;
mod region;
mod regions;
mod simulator;
mod skin;
mod sleep;
mod source;
mod stage;
#[cfg(test)]
mod tests;
mod words;

pub use cage::CageEntry;
pub use checkpoint::Checkpoint;
pub use material::{MaterialEntry, TissueEntry, TissueTable};
#[cfg(feature = "study")]
pub(crate) use measure::median_ms;
pub use measure::{CgReport, StageReport};
pub use motion::Motion;
pub(crate) use picture::SIZE;
pub use region::{Axis, LabelOrName, Region};
pub use source::ScalarField;
pub use stage::{STEPS, Stage};

use crate::mesher::{Length, Window};
use crate::physics::EngineChoice;
use crate::skin::Mapping;
use crate::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Everything needed to make a picture or a series; see the [module](self) for the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Where the mesh comes from.
    #[serde(default)]
    pub mesh: MeshSource,
    /// Several bodies, in place of one mesh.
    #[serde(default)]
    pub body: Vec<BodyEntry>,
    /// What the body is made of.
    #[serde(default)]
    pub material: MaterialEntry,
    /// How it moves; with no solver named it does not.
    #[serde(default)]
    pub solver: SolverEntry,
    /// Nodes that stay where they are.
    #[serde(default)]
    pub pin: Vec<Region>,
    /// Forces on groups of nodes.
    #[serde(default)]
    pub force: Vec<ForceEntry>,
    /// Makes the body a grid of particles in place of tets.
    pub grid: Option<GridEntry>,
    /// Simulates a coarse body in place of the mesh, which it carries.
    pub cage: Option<CageEntry>,
    /// A floor that pushes the body back.
    pub floor: Option<FloorEntry>,
    /// What grabs the body, and where to.
    #[serde(default)]
    pub grab: Vec<GrabEntry>,
    /// What cuts it.
    #[serde(default)]
    pub cut: Vec<CutEntry>,
    /// Surfaces that the body carries.
    #[serde(default)]
    pub skin: Vec<SkinEntry>,
    /// The view; the whole mesh is framed where nothing else is said.
    #[serde(default)]
    pub camera: CameraEntry,
    /// The picture.
    #[serde(default)]
    pub picture: PictureEntry,
}

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
    /// A generator's name, instead of a file; see [`crate::mesh::generate::GENERATORS`].
    #[serde(default, deserialize_with = "words::generator")]
    pub generate: Option<String>,
    /// About how many tets the generator or the mesher makes.
    pub tets: Option<usize>,
    /// Edge length at boundaries, instead of `tets`: `"2mm"`, or a number in the file's unit.
    #[serde(default, deserialize_with = "said")]
    pub edge: Option<Length>,
    /// Which labels of a volume are regions: `"all"`, or a list.
    pub labels: Option<LabelsEntry>,
    /// Thresholds from which on a volume's values are a region, each up to the next: numbers, or
    /// `"NAME=VALUE"`.
    #[serde(default, deserialize_with = "all_said")]
    pub above: Vec<Window>,
    /// Ranges of a volume's values that are a region: `"LOW..HIGH"`, `"NAME=LOW..HIGH"`.
    #[serde(default, deserialize_with = "all_said")]
    pub between: Vec<Window>,
    /// Times by which edges may be longer away from boundaries.
    pub grading: Option<f64>,
    /// Pieces of regions of less volume are given to what surrounds them.
    pub min_island: Option<f64>,
    /// What one unit of the mesh is: `m`, `cm`, `mm`, `um`, or a number of metres; what the mesh
    /// file says by default, or else `m`.
    #[serde(default, deserialize_with = "words::unit")]
    pub unit: Option<Unit>,
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
    #[serde(default, deserialize_with = "words::solver")]
    pub solver: Option<String>,
    /// What computes its steps; `[solver] engine` where nothing is said.
    #[serde(default, deserialize_with = "words::engine")]
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
    All(All),
}

/// The word `all`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum All {
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

fn said<'de, T, D>(from: D) -> std::result::Result<Option<T>, D::Error>
where
    T: FromStr<Err = Error>,
    D: Deserializer<'de>,
{
    Said::deserialize(from)?.parse().map(Some)
}

fn all_said<'de, T, D>(from: D) -> std::result::Result<Vec<T>, D::Error>
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

/// How the body moves.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolverEntry {
    /// `explicit`, `symplectic`, `verlet`, `velocity-verlet` or `implicit`.
    #[serde(default, deserialize_with = "words::solver")]
    pub name: Option<String>,
    /// What computes the steps: `auto`, `gpu` or `cpu`.
    #[serde(default, deserialize_with = "words::engine")]
    pub engine: Option<EngineChoice>,
    /// Step size in seconds.
    pub dt: Option<f64>,
    /// Steps before the picture, or between two frames of a series.
    pub steps: Option<u32>,
    /// Gravity in m/s².
    pub gravity: Option<[f64; 3]>,
    /// Conjugate gradients: most iterations a step.
    pub iterations: Option<u32>,
    /// Conjugate gradients: residual, relative to the right-hand side, at which they stop.
    pub tolerance: Option<f64>,
    /// Whether the body falls asleep when it is at rest; it does where nothing is said.
    pub sleep: Option<bool>,
    /// The run that is ahead. With it, a body that nothing holds, pulls or cuts gets a load and
    /// an implicit step that suit its stiffness, in place of the earth's gravity and 0.01 s, and
    /// a view that nobody chose shows all that moves. Set by the command line.
    #[serde(skip)]
    pub run: Option<Run>,
}

/// A run that is ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Its steps in all.
    pub steps: u32,
    /// Whether pictures are drawn on the way, which have to be framed before it is over.
    pub drawn: bool,
}

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
    #[serde(default, deserialize_with = "all_said")]
    pub above: Vec<Window>,
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
    #[serde(default, deserialize_with = "words::preset")]
    pub transfer: Option<String>,
    /// From 0, invisible, to 1, opaque.
    pub opacity: Option<f32>,
    /// A PNG of tangent-space normals, by texture coordinates.
    pub normal_map: Option<PathBuf>,
    /// A PNG of heights, by texture coordinates.
    pub height_map: Option<PathBuf>,
    /// How deep the height map is, in texture coordinates.
    pub height: Option<f32>,
}

/// The view, in the units of the mesh file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Where the camera is.
    pub eye: Option<[f64; 3]>,
    /// What it looks at.
    pub look_at: Option<[f64; 3]>,
    /// Which way is up.
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, in degrees.
    pub fov: Option<f64>,
    /// Height of the view for an orthographic camera, instead of `fov`.
    pub orthographic: Option<f64>,
}

impl CameraEntry {
    /// Whether nothing of the view is said.
    pub fn is_unset(&self) -> bool {
        let places = [self.eye, self.look_at, self.up];
        places.iter().all(Option::is_none) && self.fov.is_none() && self.orthographic.is_none()
    }
}

/// The picture.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureEntry {
    /// The field that is seen. Where nothing is said: the regions, a colour each, unless there is
    /// a `transfer`; or the first scalar at the nodes, or the depth below the surface.
    pub field: Option<String>,
    /// A preset's name, a JSON file beside the scene file, or the JSON itself.
    #[serde(default, deserialize_with = "words::transfer")]
    pub transfer: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// `composite`, `thickness`, `surface`, or `skin`: the skins alone, without the inside.
    #[serde(default, deserialize_with = "words::mode")]
    pub mode: Option<String>,
    /// `vertices` or `planes`.
    #[serde(default, deserialize_with = "words::walk")]
    pub walk: Option<String>,
    /// What is behind the volume in a PNG: `black`, `white` or `transparent`.
    #[serde(default, deserialize_with = "words::background")]
    pub background: Option<String>,
    /// The most surface layers a ray may enter.
    pub layers: Option<u32>,
    /// Error of the picture's values, of 1, that the size of the table is chosen for; 0.001 where
    /// nothing is said.
    pub accuracy: Option<f64>,
    /// Bits a channel of a PNG: 8 or 16.
    pub bits: Option<u32>,
    /// The root mean square error that its values may have, in 1/255: the cheapest settings that
    /// were measured to keep to it are taken. 0.5 where nothing is said.
    pub quality: Option<f64>,
    /// With skins: the picture is drawn so many times larger each way, and averaged; 2 where
    /// nothing is said. A translucent skin over a volume is quicker with 1.
    pub samples: Option<u32>,
}

impl Scene {
    /// Reads a scene file; paths in it are made relative to its folder.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] with the line and the column of what is wrong: a key
    /// that is not known, a value of the wrong type, a word that is none of those expected.
    pub fn read(path: impl AsRef<Path>) -> Result<Scene> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let mut scene = Scene::parse(&text).map_err(|e| Error::format(path, e.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let bodies = scene.body.iter_mut().map(|body| &mut body.mesh);
        for mesh in bodies.chain([&mut scene.mesh]) {
            mesh.file = mesh.file.take().map(|file| folder.join(file));
        }
        for skin in &mut scene.skin {
            skin.file = folder.join(&skin.file);
            for map in [&mut skin.normal_map, &mut skin.height_map] {
                *map = map.take().map(|file| folder.join(file));
            }
        }
        if let Some(transfer) = &mut scene.picture.transfer
            && transfer.ends_with(".json")
        {
            *transfer = folder.join(&transfer).to_string_lossy().into_owned();
        }
        Ok(scene)
    }

    /// Parses the text of a scene; paths in it are as they stand.
    ///
    /// # Errors
    /// [`Error::Input`] with the line that is wrong.
    pub fn parse(text: &str) -> Result<Scene> {
        toml::from_str(text).map_err(|e| Error::Input(e.to_string()))
    }

    /// The scene that a mesh file alone makes: at rest, framed, everything by default.
    pub fn of_mesh(path: impl AsRef<Path>) -> Scene {
        Scene {
            mesh: MeshSource {
                file: Some(path.as_ref().to_path_buf()),
                ..MeshSource::default()
            },
            ..Scene::default()
        }
    }
}
