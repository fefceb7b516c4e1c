//! A scene: a TOML file with a mesh, a material, a solver, supports and loads, a camera, a transfer
//! function and a picture. Only the mesh is required; a scene of several bodies has a [`BodyEntry`]
//! for each.
//!
//! ```toml
//! [mesh]
//! file = "liver.vtu"      # in the folder of the scene file; or generate = "limb", tets = 100000
//! unit = "mm"             # length unit of the mesh, needed for physics
//!
//! [material]
//! young = 2e4             # Pa; or stiffness = 3000 (N/m, for each spring)
//! bone = ["femur", 6]     # regions of a tissue, by name or label: published values
//!
//! [solver]
//! name = "implicit"
//! dt = 0.01               # s
//! steps = 100
//!
//! [[pin]]                 # fixed nodes
//! axis = "z"
//! below = 0.05            # the lowest 5 % of the bounds; or z_below = -0.6, in the mesh's unit
//!
//! [[force]]
//! on = { axis = "z", above = 0.95 }
//! total = [0.0, -2.0, 0.0]  # N, distributed over the nodes of the region
//!
//! [picture]
//! field = "intensity"
//! transfer = "muscle"
//! size = [1024, 768]
//! ```

mod active_blade;
mod active_grab;
mod annotations;
mod appearance;
mod bodies;
mod cage;
mod checkpoint;
mod computed_field;
mod default_load;
mod drawn_mesh;
mod dynamic_tools;
mod element_order;
mod entries;
mod even_traction;
mod grid;
mod joint;
mod keywords;
mod light;
mod material;
mod mesh_manifest;
mod mesh_source;
mod missing_values;
mod motion;
mod motion_gradient;
mod patch;
mod picture;
mod pieces;
mod preloaded;
mod present_loads;
mod reactions;
mod region;
mod region_appearance;
mod regions;
mod renamed_keys;
mod resolution;
mod rest;
mod scan;
#[cfg(feature = "cli")]
mod schema;
mod simulator;
mod skin;
mod sleep;
mod stage;
#[cfg(test)]
mod tests;
mod time_dependent_loads;
mod tool;
mod tool_skin;
mod trajectory;
mod xray;

pub use annotations::PictureWriter;
pub(crate) use cage::CageEntry;
pub use checkpoint::Checkpoint;
pub(crate) use checkpoint::scene_hash;
pub use element_order::OrderChoice;
pub use entries::*;
pub use material::MaterialEntry;
pub(crate) use material::{TissueEntry, TissueTable};
pub use mesh_source::{ERROR_FIELD, ScalarField};
pub use motion::Motion;
pub(crate) use patch::ScenePatch;
pub(crate) use picture::DEFAULT_SIZE;
pub use pieces::{Piece, write_pieces};
pub use preloaded::Preloaded;
pub(crate) use present_loads::PresentLoads;
pub(crate) use reactions::NamedPins;
pub use reactions::ReactionLog;
pub(crate) use region::{LabelOrName, Region};
#[cfg(feature = "study")]
pub(crate) use stage::median_ms;
pub use stage::{CgReport, FieldRanges, PendingImage, Stage, StageReport, ToolReport};

use crate::files;
use crate::physics::EngineChoice;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Description of a picture or a series; see the [module](self) for the file format.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Source of the mesh.
    #[serde(default)]
    pub mesh: MeshSource,
    /// Several bodies, instead of one mesh.
    #[serde(default)]
    pub body: Vec<BodyEntry>,
    /// Material of the body.
    #[serde(default)]
    pub material: MaterialEntry,
    /// Time integration; without a solver name the body is static.
    #[serde(default)]
    pub solver: SolverEntry,
    /// Fixed nodes.
    #[serde(default)]
    pub(crate) pin: Vec<Region>,
    /// Forces on groups of nodes.
    #[serde(default)]
    pub(crate) force: Vec<ForceEntry>,
    /// Masses that move with groups of nodes.
    #[serde(default)]
    pub(crate) mass: Vec<MassEntry>,
    /// Replaces the tetrahedra by a grid of particles.
    pub(crate) grid: Option<GridEntry>,
    /// Simulates a coarse cage in which the mesh is embedded, instead of the mesh.
    pub(crate) cage: Option<CageEntry>,
    /// A floor in contact with the body.
    pub(crate) floor: Option<FloorEntry>,
    /// Grabs and their paths.
    #[serde(default)]
    pub(crate) grab: Vec<GrabEntry>,
    /// Pressures on patches of the boundary.
    #[serde(default)]
    pub(crate) pressure: Vec<PressureEntry>,
    /// Nodes with prescribed displacement.
    #[serde(default, rename = "move")]
    pub(crate) moves: Vec<MoveEntry>,
    /// Contracting regions.
    #[serde(default)]
    pub(crate) muscle: Vec<MuscleEntry>,
    /// Tools in contact with the body.
    #[serde(default)]
    pub(crate) tool: Vec<ToolEntry>,
    /// The dynamic tools, which are regions of the mesh: see [`Scene::with_dynamic_tools`].
    #[serde(skip)]
    pub(crate) carried: Vec<ToolEntry>,
    /// Joints between rigid regions.
    #[serde(default)]
    pub(crate) joint: Vec<JointEntry>,
    /// Self-contact of the body.
    pub(crate) contact: Option<ContactEntry>,
    /// Cuts of the body.
    #[serde(default)]
    pub(crate) cut: Vec<CutEntry>,
    /// Surfaces embedded in the body.
    #[serde(default)]
    pub skin: Vec<SkinEntry>,
    /// Volumes embedded in the body, rendered in place of its fields.
    #[serde(default, deserialize_with = "entries::scans")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::scans"))]
    pub scan: Vec<ScanEntry>,
    /// The camera; default: the whole mesh is framed.
    #[serde(default)]
    pub camera: CameraEntry,
    /// Lighting of the volume.
    #[serde(default)]
    pub light: LightEntry,
    /// Settings of X-ray pictures.
    #[serde(default)]
    pub xray: XrayEntry,
    /// Section planes through the volume.
    #[serde(default)]
    pub plane: Vec<PlaneEntry>,
    /// Isosurfaces.
    #[serde(default)]
    pub isosurface: Vec<IsosurfaceEntry>,
    /// The picture.
    #[serde(default)]
    pub picture: PictureEntry,
    /// Files written in addition to the pictures.
    #[serde(default)]
    pub output: OutputEntry,
    /// How exact a number has to be.
    #[serde(default)]
    pub accuracy: AccuracyEntry,
    /// Notes of old keys in the scene file.
    #[serde(skip)]
    pub(crate) notes: Vec<String>,
}

/// Time integration of the body.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SolverEntry {
    /// `explicit`, `symplectic`, `verlet`, `velocity-verlet` or `implicit`; for finite elements on
    /// the CPU also `bdf2` and `midpoint`.
    #[serde(default, deserialize_with = "keywords::solver")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::solver", extend("examples" = ["implicit"])))]
    pub name: Option<String>,
    /// Engine of the time steps: `auto`, `gpu`, `cpu`, or `rapier` in builds that include it.
    #[serde(default, deserialize_with = "keywords::engine")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::engine", extend("default" = "auto", "examples" = ["cpu"])))]
    pub engine: Option<EngineChoice>,
    /// Time step, s.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s", "exclusiveMinimum" = 0.0, "examples" = [0.01])))]
    pub dt: Option<f64>,
    /// Number of steps before the picture, or between two frames of a series.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [50])))]
    pub steps: Option<u32>,
    /// Gravity, m/s².
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "m/s²", "examples" = [[0.0, 0.0, -9.81]])))]
    pub gravity: Option<[f64; 3]>,
    /// Largest number of conjugate gradient iterations per step.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 2000, "minimum" = 1, "examples" = [500])))]
    pub iterations: Option<u32>,
    /// Relative residual at which conjugate gradients stop.
    #[cfg_attr(feature = "cli", schemars(extend("exclusiveMinimum" = 0.0, "examples" = [1e-5])))]
    pub tolerance: Option<f64>,
    /// Whether steps may invert tets; by default such a step fails, unless the load was chosen
    /// automatically.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [true])))]
    pub allow_inversion: Option<bool>,
    /// Whether the body sleeps when at rest; default true.
    #[cfg_attr(feature = "cli", schemars(extend("default" = true, "examples" = [false])))]
    pub sleep: Option<bool>,
    /// The planned run. If it is set, a body without supports, loads or cuts gets a load and an
    /// implicit time step chosen from its stiffness, instead of the earth's gravity and 0.01 s, and
    /// the default camera frames the whole motion. Set by the command line.
    #[serde(skip)]
    pub run: Option<PlannedRun>,
}

/// Length and output of a planned run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedRun {
    /// Total number of steps.
    pub steps: u32,
    /// Whether pictures are drawn during the run, which have to be framed before it ends.
    pub draws_frames: bool,
}

impl PlannedRun {
    /// Number of steps before a picture, if the scene has a solver and does not state it.
    pub const DEFAULT_STEPS: u32 = 50;
}

impl Scene {
    /// Whether its loads or the motion of its tools depend on time.
    pub fn is_time_dependent(&self) -> bool {
        let moves = |t: &ToolEntry| t.path.is_some() || t.file.is_some() || t.rotation.is_some();
        !(self.grab.is_empty()
            && self.cut.is_empty()
            && self.moves.is_empty()
            && self.muscle.is_empty()
            && self.pressure.is_empty())
            || self.tool.iter().any(moves)
    }

    /// Reads a scene file; relative paths in it are resolved against its folder.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] with the line and column of the error: an unknown key, a
    /// value of the wrong type or an unknown keyword.
    pub fn read(path: impl AsRef<Path>) -> Result<Scene> {
        Scene::read_file(path.as_ref())
    }

    fn read_file(path: &Path) -> Result<Scene> {
        let text = files::read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Scene::parse_in(&text, folder).map_err(|e| Error::format(path, e.to_string()))
    }

    /// Parses the text of a scene; relative paths in it are resolved against `folder`.
    ///
    /// # Errors
    /// As [`Scene::parse`].
    pub fn parse_in(text: &str, folder: &Path) -> Result<Scene> {
        let mut scene = Scene::parse(text)?;
        let bodies = scene.body.iter_mut().map(|body| &mut body.mesh);
        for mesh in bodies.chain([&mut scene.mesh]) {
            for file in [&mut mesh.file, &mut mesh.rest] {
                *file = file.take().map(|file| folder.join(file));
            }
            for other in &mut mesh.join {
                other.file = other.file.take().map(|file| folder.join(file));
            }
        }
        for entry in &mut scene.moves {
            entry.file = entry.file.take().map(|file| folder.join(file));
        }
        for entry in &mut scene.tool {
            for file in [&mut entry.file, &mut entry.surface] {
                *file = file.take().map(|file| folder.join(file));
            }
        }
        for skin in &mut scene.skin {
            skin.file = folder.join(&skin.file);
            for map in [&mut skin.normal_map, &mut skin.height_map] {
                *map = map.take().map(|file| folder.join(file));
            }
        }
        for scan in &mut scene.scan {
            scan.file = folder.join(&scan.file);
            if let Some(json) = scan.transfer_file() {
                *json = folder.join(&json).to_string_lossy().into_owned();
            }
        }
        for transfer in scene.picture.transfer_files() {
            *transfer = folder.join(&transfer).to_string_lossy().into_owned();
        }
        for map in scene.light.environment_file() {
            *map = folder.join(&map).to_string_lossy().into_owned();
        }
        Ok(scene)
    }

    /// Parses the text of a scene; paths in it are kept as given.
    ///
    /// # Errors
    /// [`Error::Input`] with the line of the error.
    pub fn parse(text: &str) -> Result<Scene> {
        renamed_keys::parse(text).map_err(|e| Error::Input(e.to_string()))
    }

    /// Whether its stage creates the mesh from several bodies or as a grid, and not from the entry
    /// `mesh` alone.
    pub fn creates_meshes(&self) -> bool {
        !self.body.is_empty() || self.grid.is_some()
    }

    /// Returns notes of keys of the scene file that have new names. [`Stage::notes`] contains them.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the name of an entry that only a single tetrahedral body supports, if there is one.
    pub(crate) fn tets_only_entry(&self) -> Option<&'static str> {
        let tool = (!self.tool.is_empty()).then_some("[[tool]]");
        let joint = (!self.joint.is_empty()).then_some("[[joint]]");
        let mass = (!self.mass.is_empty()).then_some("[[mass]]");
        self.cpu_only_entry().or(tool).or(joint).or(mass)
    }

    /// Returns the name of an entry that only the CPU engine supports, if there is one.
    pub(crate) fn cpu_only_entry(&self) -> Option<&'static str> {
        let all = [
            (self.pressure.is_empty(), "[[pressure]]"),
            (self.moves.is_empty(), "[[move]]"),
            (self.muscle.is_empty(), "[[muscle]]"),
            (self.contact.is_none(), "[contact]"),
        ];
        all.into_iter()
            .find(|(none, _)| !none)
            .map(|(_, name)| name)
    }

    /// Returns the default scene of a mesh file: static, framed, with all defaults.
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
