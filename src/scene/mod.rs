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

mod active_blade;
mod active_grab;
mod annotations;
mod appearance;
mod bodies;
mod cage;
mod checkpoint;
mod computed_field;
mod default_load;
mod drawing;
mod dynamic_tools;
mod entries;
mod grid;
mod joint;
mod keywords;
mod material;
mod mesh_manifest;
mod mesh_source;
mod motion;
mod picture;
mod pieces;
mod preloaded;
mod reactions;
mod region;
mod region_appearance;
mod regions;
mod rest;
mod scan;
mod series_frame;
mod simulator;
mod skin;
mod sleep;
mod stage;
mod stage_report;
#[cfg(test)]
mod tests;
mod time_dependent_loads;
mod tool;
mod tool_skin;
mod trajectory;
mod xray;

pub use annotations::PictureWriter;
pub use cage::CageEntry;
pub use checkpoint::Checkpoint;
pub(crate) use checkpoint::scene_hash;
pub use drawing::PendingImage;
pub use entries::*;
pub use material::{MaterialEntry, TissueEntry, TissueTable};
pub use mesh_manifest::MeshManifest;
pub use mesh_source::ScalarField;
pub use motion::Motion;
pub(crate) use picture::DEFAULT_SIZE;
pub use pieces::{Piece, write_pieces};
pub use preloaded::Preloaded;
pub use reactions::ReactionLog;
pub use region::{Axis, LabelOrName, Region};
pub use stage::{STEPS, Stage};
#[cfg(feature = "study")]
pub(crate) use stage_report::median_ms;
pub use stage_report::{CgReport, StageReport, ToolReport};

use crate::files;
use crate::physics::EngineChoice;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

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
    /// Pressure on patches of its boundary.
    #[serde(default)]
    pub pressure: Vec<PressureEntry>,
    /// Nodes that are moved along paths.
    #[serde(default, rename = "move")]
    pub moves: Vec<MoveEntry>,
    /// What contracts.
    #[serde(default)]
    pub muscle: Vec<MuscleEntry>,
    /// What presses on it.
    #[serde(default)]
    pub tool: Vec<ToolEntry>,
    /// Those of them that are regions of the mesh: see [`Scene::with_dynamic_tools`].
    #[serde(skip)]
    pub(crate) carried: Vec<ToolEntry>,
    /// Joints between its rigid regions.
    #[serde(default)]
    pub joint: Vec<JointEntry>,
    /// Contact of the body with itself.
    pub contact: Option<ContactEntry>,
    /// What cuts it.
    #[serde(default)]
    pub cut: Vec<CutEntry>,
    /// Surfaces that the body carries.
    #[serde(default)]
    pub skin: Vec<SkinEntry>,
    /// Volumes that the body carries, shown in place of its fields.
    #[serde(default, deserialize_with = "entries::scans")]
    pub scan: Vec<ScanEntry>,
    /// The view; the whole mesh is framed where nothing else is said.
    #[serde(default)]
    pub camera: CameraEntry,
    /// The light on the inside.
    #[serde(default)]
    pub light: LightEntry,
    /// X-rays.
    #[serde(default)]
    pub xray: XrayEntry,
    /// Planes through the volume.
    #[serde(default)]
    pub plane: Vec<PlaneEntry>,
    /// Surfaces of one value.
    #[serde(default)]
    pub isosurface: Vec<IsosurfaceEntry>,
    /// The picture.
    #[serde(default)]
    pub picture: PictureEntry,
    /// What is written beside pictures.
    #[serde(default)]
    pub output: OutputEntry,
}

/// How the body moves.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolverEntry {
    /// `explicit`, `symplectic`, `verlet`, `velocity-verlet` or `implicit`; of elements on the CPU
    /// also `bdf2` and `midpoint`.
    #[serde(default, deserialize_with = "keywords::solver")]
    pub name: Option<String>,
    /// What computes the steps: `auto`, `gpu`, `cpu`, or `rapier` in builds that have it.
    #[serde(default, deserialize_with = "keywords::engine")]
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
    pub run: Option<PlannedRun>,
}

/// A run that is ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedRun {
    /// Its steps in all.
    pub steps: u32,
    /// Whether pictures are drawn on the way, which have to be framed before it is over.
    pub draws_frames: bool,
}

impl Scene {
    /// Reads a scene file; paths in it are made relative to its folder.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] with the line and the column of what is wrong: a key
    /// that is not known, a value of the wrong type, a word that is none of those expected.
    pub fn read(path: impl AsRef<Path>) -> Result<Scene> {
        Scene::read_file(path.as_ref())
    }

    fn read_file(path: &Path) -> Result<Scene> {
        let text = files::read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Scene::parse_in(&text, folder).map_err(|e| Error::format(path, e.to_string()))
    }

    /// Parses the text of a scene; paths in it are made relative to `folder`.
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
            if let Some(json) = scan.transfer.as_mut().filter(|t| t.ends_with(".json")) {
                *json = folder.join(&json).to_string_lossy().into_owned();
            }
        }
        for transfer in scene.picture.transfer_files() {
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

    /// What it has that only a body of tets by itself knows of, by the name of its entry.
    pub(crate) fn tets_only_entry(&self) -> Option<&'static str> {
        let tool = (!self.tool.is_empty()).then_some("[[tool]]");
        let joint = (!self.joint.is_empty()).then_some("[[joint]]");
        self.cpu_only_entry().or(tool).or(joint)
    }

    /// What it has that only the processor's engine knows of, by the name of its entry.
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
