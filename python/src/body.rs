//! The body behind a Python stage.

use palpate::physics::Simulator;
use palpate::press::PressSession;
use palpate::scene::{Motion, Stage};
use palpate::{Error, Result};

/// A stage, and the fingertip of a body that is pressed on interactively.
pub struct Body {
    pub stage: Stage,
    pub fingertip: Option<PressSession>,
}

/// Returns the simulated body.
pub fn motion(stage: &mut Stage) -> Result<&mut Motion> {
    stage.motion_mut().ok_or_else(|| {
        Error::Input("the scene is static; set a solver, such as solver=\"implicit\"".into())
    })
}

/// Returns its simulator.
pub fn simulator(stage: &mut Stage) -> Result<&mut dyn Simulator> {
    Ok(motion(stage)?.simulator.as_mut())
}
