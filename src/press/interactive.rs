//! The stage of a body that is pressed on interactively.

use super::session::PressSession;
use super::setup::PressSetup;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::scene::{Scene, Stage};
use crate::{Error, Result};

/// A stage, and the fingertip of its body if it can be pressed on.
pub struct InteractiveStage {
    /// The stage.
    pub stage: Stage,
    /// The scene that it shows, with the fingertip among its tools.
    pub scene: Scene,
    /// The fingertip, or why the body cannot be pressed on.
    pub fingertip: std::result::Result<PressSession, String>,
}

impl InteractiveStage {
    /// Creates the stage of `scene` with `mesh`, which the scene generates itself if it has several
    /// bodies or a grid. A `radius` of the fingertip that is not given is chosen from the body's
    /// shape.
    ///
    /// # Errors
    /// As [`Stage::with_mesh`]; a body that cannot be pressed on is no error.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        mesh: &TetMesh,
        radius: Option<f64>,
    ) -> Result<InteractiveStage> {
        let own_mesh = !scene.body.is_empty() || scene.grid.is_some();
        let plain = |why: &Error| {
            let stage = match own_mesh {
                true => Stage::new(gpu, scene),
                false => Stage::with_mesh(gpu, scene, mesh.clone()),
            };
            Ok(InteractiveStage {
                stage: stage?,
                scene: scene.clone(),
                fingertip: Err(why.to_string()),
            })
        };
        let setup = match PressSetup::interactive(scene, mesh, radius) {
            Ok(setup) => setup,
            Err(why) => return plain(&why),
        };
        let mut stage = match Stage::with_mesh(gpu, &setup.scene, mesh.clone()) {
            Ok(stage) => stage,
            // Some bodies that move do not support tools.
            Err(why) => return plain(&why),
        };
        let scene = setup.scene.clone();
        let Some(motion) = stage.motion_mut() else {
            return plain(&super::session::static_body());
        };
        Ok(InteractiveStage {
            fingertip: Ok(PressSession::new(setup, motion)),
            stage,
            scene,
        })
    }
}
