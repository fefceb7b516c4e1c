//! Session of an open body: real-time stepping, manual interaction and rendering.

mod appearance;
mod create;
mod edits;
mod press;
mod press_error;
mod section;
mod stepping;

pub use edits::RebuildRequest;

use crate::body_edits::BodyEditHistory;
use crate::loading::ReadScan;
use crate::series::Player;
use glam::{DVec2, DVec3};
use palpate::gpu::Recorder;
use palpate::mesh::{Blade, TetMesh};
use palpate::physics::GrabId;
use palpate::press::PressSession;
use palpate::render::{Camera, Pick, ProgressivePaths};
use palpate::scene::{PendingImage, Scene, SkinEntry, Stage};
use palpate::{Error, Result};
use press::Press;
pub use press_error::PressError;
use press_error::PressErrorEstimate;
use section::PressSection;
pub use section::{SectionOptions, SectionPixels};
use std::sync::Arc;
use web_time::Instant;

/// Session of an open body.
pub struct BodySession {
    stage: Stage,
    /// The mesh as read or generated.
    pub mesh: Arc<TetMesh>,
    /// Bounds of the body at rest.
    pub bounds: (DVec3, DVec3),
    /// Metres per file unit.
    pub unit: f64,
    /// Radius of the finger, in file units.
    pub radius: f64,
    /// The fingertip, or why the body cannot be pressed on.
    fingertip: std::result::Result<PressSession, String>,
    press: Option<Press>,
    /// The error of its force.
    press_error: PressErrorEstimate,
    /// The section through the body under it.
    section: PressSection,
    /// The grab, its initial position, and its displacement.
    grab: Option<(GrabId, DVec3, DVec3)>,
    /// Pending cut, the number of scene edits before it, and whether it is a redo.
    blade: Option<(Blade, usize, bool)>,
    /// History of manual edits.
    pub edits: BodyEditHistory,
    /// The scene that the stage was created from.
    made: Scene,
    /// Scans and skins read so far.
    read: (Vec<ReadScan>, Vec<SkinEntry>),
    /// The recorded series, if one is shown.
    pub player: Option<Player>,
    /// Whether the simulation is playing.
    pub playing: bool,
    /// Simulated seconds per second.
    pub speed: f64,
    owed: f64,
    /// Whether the scene has time-dependent loads.
    timed: bool,
    /// Whether an interaction since the last step requires a new step.
    stirred: bool,
    /// Whether a requested step may still be running.
    under_way: bool,
    /// Request times of press changes: the one that awaits a step, and the one that the running
    /// step applies.
    asked: [Option<Instant>; 2],
    /// The request time of the last completed step, for the latency of its picture.
    pub shown: Option<Instant>,
    last: Instant,
    counted: (Instant, u64),
    /// Number of steps done.
    pub steps: u64,
    /// Recent steps per second.
    pub rate: f64,
    /// Why the last step failed.
    pub failure: Option<String>,
    /// Whether any step failed.
    pub failed: bool,
    /// Remark on the last step that is not an error.
    pub remark: Option<String>,
    /// Changes whenever the picture changes, except for the camera.
    pub version: u64,
    /// Automatic choices, as text.
    pub notes: Vec<String>,
}

impl BodySession {
    /// Returns the stage.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// Returns the diagonal of the body at rest, in file units.
    pub fn diagonal(&self) -> f64 {
        self.bounds.0.distance(self.bounds.1).max(f64::MIN_POSITIVE)
    }

    /// Returns the stage for changes of the rendering.
    pub fn stage_mut(&mut self) -> &mut Stage {
        self.version += 1;
        &mut self.stage
    }

    /// Whether a press or a grab is active.
    pub fn touched(&self) -> bool {
        self.press.is_some() || self.grab.is_some()
    }

    /// Picks the body at a pixel of the view of `camera` with `size` pixels.
    ///
    /// # Errors
    /// The errors of [`Stage::pick`].
    pub fn pick(&mut self, camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<Option<Pick>> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.pick(pixel)
    }

    /// Records the rendering of the view of `camera` into `colour`, over `backdrop`.
    ///
    /// # Errors
    /// The errors of [`Stage::record`].
    pub fn record(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        (colour, backdrop): (&wgpu::TextureView, [f32; 4]),
    ) -> Result<()> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_backdrop(backdrop);
        self.stage.record(work, colour)
    }

    /// Starts the picture by light paths of the last recorded view, with `size` pixels; `None` while its
    /// surfaces are read back, as [`Stage::start_paths`].
    ///
    /// # Errors
    /// The errors of [`Stage::start_paths`].
    pub fn start_paths(&mut self, size: [u32; 2], fresh: bool) -> Result<Option<ProgressivePaths>> {
        self.stage.start_paths(size, fresh)
    }

    /// Creates the rendering pipelines, so that the first picture is not delayed.
    ///
    /// # Errors
    /// The errors of [`Stage::render_async`].
    pub(crate) fn prepare_pictures(&mut self) -> Result<()> {
        let size = self.stage.size();
        self.stage.set_size([64, 64]);
        let asked = self.stage.render_async();
        self.stage.set_size(size);
        asked.map(|_| ())
    }

    /// Starts rendering the view of `camera` with `size` pixels, without waiting.
    ///
    /// # Errors
    /// The errors of [`Stage::render_async`].
    pub fn ask_image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<PendingImage> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.render_async()
    }
}

fn still() -> Error {
    Error::Input("a static body cannot be grabbed or pinned; a simulated body is required".into())
}
