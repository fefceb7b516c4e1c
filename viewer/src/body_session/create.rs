//! Creation of the session of a scene, with a finger, a solver and supports where it has none.

use super::BodySession;
use crate::body_edits::BodyEditHistory;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::mesh::{TetMesh, Topology};
use palpate::press::{InteractiveStage, PressSession, PressSite};
use palpate::scene::{Motion, Scene, Stage};
use std::sync::Arc;
use web_time::Instant;

/// Note for a scene with light paths.
const LIGHT_PATHS: &str = "the light is local while something moves; at rest, light paths set in";

impl BodySession {
    /// Creates the session of `scene` with `mesh`, with a finger of `radius` or of a default
    /// radius.
    ///
    /// # Errors
    /// The errors of [`Stage::with_mesh`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
    ) -> Result<BodySession> {
        let made = InteractiveStage::new(gpu, scene, &mesh, radius)?;
        Ok(BodySession::on(
            made.stage,
            (&made.scene, scene.clone()),
            mesh,
            radius,
            made.fingertip,
        ))
    }

    /// Creates the session of `scene` as a static body.
    pub(crate) fn static_body(gpu: &Gpu, scene: &Scene, mesh: Arc<TetMesh>) -> Result<BodySession> {
        let mut still = scene.clone();
        still.solver.name = None;
        let stage = Stage::with_mesh(gpu, &still, (*mesh).clone())?;
        let fingertip = Err("a recorded series is not simulated; open one frame".into());
        Ok(BodySession::on(
            stage,
            (&still, scene.clone()),
            mesh,
            None,
            fingertip,
        ))
    }

    /// Creates the session of a stage that was created from the completed scene `made`.
    fn on(
        stage: Stage,
        (scene, made): (&Scene, Scene),
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
        fingertip: std::result::Result<PressSession, String>,
    ) -> BodySession {
        let mut stage = stage;
        if stage.motion().is_some_and(Motion::has_state) {
            // Checkpoints are needed to undo cuts.
            stage.keep_checkpoints();
        }
        let now = Instant::now();
        let unit = stage.motion().map(|m| m.length_unit());
        // Scenes of several bodies and of grids generate their own mesh.
        let mesh = match mesh.tets.is_empty() {
            true => Arc::new(stage.mesh().clone()),
            false => mesh,
        };
        let radius = match &fingertip {
            Ok(session) => session.radius(),
            Err(_) => {
                radius.unwrap_or_else(|| PressSite::default_radius(&mesh, &Topology::new(&mesh)))
            }
        };
        let session = fingertip.as_ref().ok();
        let pieces = session.and_then(|session| session.pieces_warning(&mesh));
        let press_notes = fingertip
            .as_ref()
            .map_or_else(|_| Vec::new(), PressSession::notes);
        BodySession {
            bounds: stage.mesh().bounds(),
            unit: unit.or(mesh.length_unit).unwrap_or(1.0),
            notes: stage
                .notes()
                .iter()
                .cloned()
                .chain(press_notes)
                .chain(pieces)
                .chain(stage.draws_paths().then(|| LIGHT_PATHS.into()))
                .collect(),
            playing: stage.motion().is_some(),
            stage,
            mesh,
            radius,
            fingertip,
            press: None,
            press_error: super::PressErrorEstimate::default(),
            section: super::PressSection::default(),
            grab: None,
            blade: None,
            edits: BodyEditHistory::default(),
            read: (Vec::new(), made.skin.clone()),
            made,
            player: None,
            speed: 1.0,
            owed: 0.0,
            timed: scene.is_time_dependent(),
            stirred: false,
            under_way: false,
            asked: [None; 2],
            shown: None,
            last: now,
            counted: (now, 0),
            steps: 0,
            rate: 0.0,
            failure: None,
            failed: false,
            remark: None,
            version: 0,
        }
    }
}
