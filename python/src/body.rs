//! The body behind a Python stage.

use palpate::physics::Simulator;
use palpate::press::PressSession;
use palpate::scene::{Motion, Stage};
use palpate::{Error, Result};

/// Eye, target, up vector, and either the opening angle or the height of the view.
pub type View = ([f64; 3], [f64; 3], [f64; 3], Option<f64>, Option<f64>);

/// Node, tet, face, point and distance of a pick.
pub type Picked = (u32, u32, u32, [f64; 3], f64);
/// Time, depth and force of the samples of a press, and why the last force has no meaning, if so.
pub type PressCurve = (Vec<(f64, f64, f64)>, Option<String>);
/// Name, force and moment of a reaction.
pub type Exerted = (String, [f64; 3], [f64; 3]);

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
