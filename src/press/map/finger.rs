//! A simulator with a fingertip, which presses the points of a map one after another.

use super::PointResult;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{Capability, SimulatorState, SolverKind};
use crate::press::curve::{self, PressConditions};
use crate::press::curve_warnings;
use crate::press::session::{INITIAL_CLEARANCE, PressSession};
use crate::press::setup::PressSetup;
use crate::press::site::{Boundary, PressSite};
use crate::scene::Motion;
use crate::{Error, Result};

/// Loading steps at each point.
const STEPS: u32 = 6;

/// The body of a map, and how it is pressed.
pub(super) struct Bench {
    pub setup: PressSetup,
    pub mesh: TetMesh,
    /// Press depth, in file units.
    pub depth: f64,
}

impl Bench {
    /// Creates a simulator whose fingertip is away from the body.
    pub fn finger(&self, gpu: &Gpu) -> Result<Finger<'_>> {
        let kind = SolverKind::Implicit;
        let scene = &self.setup.scene;
        let (motion, _) = Motion::new(gpu, scene, kind, self.mesh.clone(), None)?;
        let saved = Capability::Checkpoints.require(motion.simulator.checkpoint())?;
        Ok(Finger {
            boundary: Boundary::at_rest(&motion),
            rest: saved.state()?,
            session: PressSession::new(self.setup.clone(), &motion),
            motion,
            bench: self,
        })
    }
}

/// A simulator with a fingertip, and its rest state.
pub(super) struct Finger<'a> {
    motion: Motion,
    session: PressSession,
    rest: SimulatorState,
    /// Boundary of the simulated body at rest.
    boundary: Boundary,
    bench: &'a Bench,
}

impl Finger<'_> {
    /// Presses the body from rest at `site`.
    ///
    /// # Errors
    /// Errors of the engine; a press with a failed step is [`PointResult::Failed`].
    pub fn press(&mut self, site: PressSite) -> Result<PointResult> {
        let (depth, begin) = (self.bench.depth, -INITIAL_CLEARANCE * self.session.radius());
        let saved = self.motion.simulator.checkpoint_mut();
        Capability::Checkpoints
            .require(saved)?
            .set_state(&self.rest)?;
        self.session
            .touch_site(&mut self.motion, &self.boundary, site)?;
        for step in 1..=STEPS {
            let goal = begin + (depth - begin) * f64::from(step) / f64::from(STEPS);
            match self.session.press_to(&mut self.motion, goal, "load") {
                Ok(None) | Err(Error::Solver { .. }) => return Ok(PointResult::Failed),
                other => other?,
            };
        }
        let samples = self.session.samples();
        let conditions = PressConditions {
            radius_m: self.session.unit() * self.session.radius(),
            ..PressConditions::default()
        };
        let report = curve::report(samples, conditions, 0.0, curve_warnings(samples));
        Ok(match report.stiffness_n_per_m {
            Some(stiffness) => PointResult::Stiffness(stiffness),
            None => PointResult::Failed,
        })
    }
}
