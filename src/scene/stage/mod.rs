//! A stage: the GPU resources, simulation and renderers of a scene.
//!
//! Methods of [`Stage`] by topic:
//!
//! | topic | file |
//! | --- | --- |
//! | creation from a scene | `create.rs` |
//! | camera and picture size | `view.rs` |
//! | appearance: sections, transfer function | `look.rs` |
//! | pictures, picking | `drawing.rs`; with annotations: `scene/annotations.rs` |
//! | steps | `steps.rs` |
//! | cuts | `cut.rs` |
//! | tools moved interactively | `tools.rs` |
//! | deformed meshes, frames of a series | `output.rs` |
//! | playback of a recorded series | `playback.rs` |
//! | measurements | `report.rs` |
//! | reactions | `scene/reactions.rs` |
//! | checkpoints | `scene/checkpoint.rs` |
//! | computed fields | `scene/computed_field.rs` |

mod create;
mod cut;
mod drawing;
mod end_notes;
mod look;
mod output;
mod paths;
mod playback;
mod report;
mod source;
mod steps;
mod tools;
mod view;

pub use drawing::PendingImage;
pub use playback::FieldRanges;
#[cfg(feature = "study")]
pub(crate) use report::median_ms;
pub use report::{CgReport, StageReport, ToolReport};
pub(super) use source::NodeSource;

use super::active_blade::ActiveBlade;
use super::appearance::SceneAppearance;
use super::checkpoint::CutHistory;
use super::{Motion, ScalarField, Scene};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::render::PathTracer;
use crate::skin::Skin;
use drawing::CachedFrame;
use paths::{PathReport, StartingPaths};

/// A scene ready to be simulated and rendered.
pub struct Stage {
    pub(super) gpu: Gpu,
    pub(super) drive: NodeSource,
    /// What of it depends on the appearance of the body.
    pub(super) looks: SceneAppearance,
    pub(super) scene: Scene,
    pub(super) cutters: Vec<ActiveBlade>,
    /// History for checkpoints, if they are kept.
    pub(super) journal: Option<CutHistory>,
    /// Background colour of recorded pictures.
    pub(super) backdrop: [f32; 4],
    pub(super) steps: u32,
    /// The last picture, while it is up to date.
    pub(super) cached: Option<CachedFrame>,
    /// Of the last picture by light paths.
    path_report: Option<PathReport>,
    /// The picture by light paths that [`Stage::refine_paths`] goes on with.
    path_tracer: Option<PathTracer>,
    /// The picture by light paths that [`Stage::start_paths`] is asked for.
    starting_paths: Option<StartingPaths>,
    /// Number of pictures rendered, and number taken from the cache.
    pub(super) pictures: [u64; 2],
    pub(super) depth: Option<wgpu::TextureView>,
    pub(super) notes: Vec<String>,
}

impl Stage {
    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        self.drive.mesh()
    }

    /// Returns the simulated body, if the scene has a solver.
    pub fn motion(&self) -> Option<&Motion> {
        match &self.drive {
            NodeSource::Posed(_) => None,
            NodeSource::Simulated(motion) => Some(motion),
        }
    }

    /// As [`Stage::motion`], mutable, to apply loads to the body.
    pub fn motion_mut(&mut self) -> Option<&mut Motion> {
        match &mut self.drive {
            NodeSource::Posed(_) => None,
            NodeSource::Simulated(motion) => Some(motion),
        }
    }

    /// Returns the displayed scalar field.
    pub fn scalar_field(&self) -> &ScalarField {
        &self.looks.scalars
    }

    /// Returns the skins in their current configuration; after a cut, in mode `skin`, the cut walls
    /// follow them.
    pub fn skins(&self) -> &[Skin] {
        &self.looks.skins
    }

    /// Returns the notes of automatic choices and repairs.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Adds a note.
    pub fn add_note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// Returns the device, and the scene as it was given.
    pub(crate) fn origin(&self) -> (&Gpu, &Scene) {
        (&self.gpu, &self.scene)
    }
}
