//! A simulator with a fingertip, which presses the points of a map one after another.

use super::PointResult;
use crate::accuracy::{ErrorParts, RestBody};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{Capability, SimulatorState, SolverKind};
use crate::press::curve::{self, PressConditions};
use crate::press::curve_warnings;
use crate::press::error::{ErrorEstimator, LoadedState, LoadedStates};
use crate::press::refined::Refinement;
use crate::press::refined_session::{StateToRefine, refine_state};
use crate::press::session::{INITIAL_CLEARANCE, PressSession};
use crate::press::setup::PressSetup;
use crate::press::site::{Boundary, PressSite};
use crate::scene::{AccuracyEntry, Motion};
use crate::{Error, ProgressFn, Result, no_progress};

/// Loading steps at each point.
const STEPS: u32 = 6;

/// Returns the depths of the loading steps at a point, for a fingertip of `radius`; lengths in one unit.
pub(crate) fn step_depths(depth: f64, radius: f64) -> impl Iterator<Item = f64> {
    let begin = -INITIAL_CLEARANCE * radius;
    (1..=STEPS).map(move |step| begin + (depth - begin) * f64::from(step) / f64::from(STEPS))
}

/// The body of a map, and how it is pressed.
pub(super) struct Bench {
    pub setup: PressSetup,
    pub mesh: TetMesh,
    /// Press depth, in file units.
    pub depth: f64,
    /// Whether the order of its elements may be raised.
    pub may_raise: bool,
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
            states: LoadedStates::default(),
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
    /// States of the last press.
    states: LoadedStates,
    bench: &'a Bench,
}

impl Finger<'_> {
    /// Presses the body from rest at `site`.
    ///
    /// # Errors
    /// Errors of the engine; a press with a failed step is [`PointResult::Failed`].
    pub fn press(&mut self, site: PressSite) -> Result<PointResult> {
        let saved = self.motion.simulator.checkpoint_mut();
        Capability::Checkpoints
            .require(saved)?
            .set_state(&self.rest)?;
        self.session
            .touch_site(&mut self.motion, &self.boundary, site)?;
        self.states = LoadedStates::default();
        for goal in step_depths(self.bench.depth, self.session.radius()) {
            match self.session.press_to(&mut self.motion, goal, "load") {
                Ok(None) | Err(Error::Solver { .. }) => return Ok(PointResult::Failed),
                Ok(Some(sample)) => self.states.push(LoadedState {
                    depth: goal,
                    force: sample.force_n,
                    positions: self.motion.positions()?,
                }),
                Err(error) => return Err(error),
            }
        }
        let samples = self.session.samples();
        let report = curve::report(samples, self.conditions(), 0.0, curve_warnings(samples));
        Ok(match report.stiffness_n_per_m {
            Some(n_per_m) => PointResult::Stiffness {
                n_per_m,
                error: None,
            },
            None => PointResult::Failed,
        })
    }

    /// As [`Finger::press`], on a mesh that is refined until the force is as exact as `wanted`. Returns
    /// the stiffness on the last mesh, with its error.
    ///
    /// # Errors
    /// As [`Finger::press`]; [`Error::Input`] for a body whose error cannot be estimated.
    pub fn press_refined(
        &mut self,
        gpu: &Gpu,
        (site, wanted): (PressSite, &AccuracyEntry),
        check: ProgressFn,
    ) -> Result<PointResult> {
        let pressed = self.press(site)?;
        let state = self.states.deepest();
        let Some(state) = state.filter(|_| pressed != PointResult::Failed) else {
            return Ok(PointResult::Failed);
        };
        let first = StateToRefine {
            session: &self.session,
            body: &RestBody::new(&self.bench.setup.scene, &self.motion)?,
            state,
            may_raise: self.bench.may_raise,
        };
        let (mesh, refinement) = refine_state(gpu, first, wanted, &mut |_, _| Ok(()), check)?;
        let bench = Bench {
            setup: self.bench.setup.on_mesh(&mesh)?,
            mesh,
            ..*self.bench
        };
        let mut finger = bench.finger(gpu)?;
        let pressed = finger.press(site)?;
        let PointResult::Stiffness { n_per_m, .. } = pressed else {
            return Ok(pressed);
        };
        let error = match refinement.error {
            Some(error) => finger.error_of_refined(gpu, (&refinement, error))?,
            None => None,
        };
        let error = error.map(|parts| parts.total());
        Ok(PointResult::Stiffness { n_per_m, error })
    }

    /// Returns the error of the stiffness of the last press, N/m, on the last mesh of `refined`, whose
    /// force has the given error by the mesh, N.
    fn error_of_refined(
        &self,
        gpu: &Gpu,
        refined: (&Refinement, f64),
    ) -> Result<Option<ErrorParts>> {
        let body = RestBody::new(&self.bench.setup.scene, &self.motion)?;
        let conditions = self.conditions();
        let estimator = self.estimator(&conditions);
        let error = estimator.of_refined(gpu, (&body, &self.states), refined)?;
        Ok(error.map(|error| error.stiffness_n_per_m))
    }

    /// Presses the body from rest at `site` and estimates the error of the stiffness, N/m; `None` if
    /// it has none.
    ///
    /// # Errors
    /// Errors of the engine.
    pub fn stiffness_error(&mut self, gpu: &Gpu, site: PressSite) -> Result<Option<ErrorParts>> {
        if self.press(site)? == PointResult::Failed {
            return Ok(None);
        }
        let conditions = self.conditions();
        let estimator = self.estimator(&conditions);
        let body = RestBody::new(&self.bench.setup.scene, &self.motion);
        let found = body.and_then(|body| estimator.run(gpu, (&body, &self.states), &no_progress));
        match found {
            Ok(found) => Ok(found.map(|error| error.stiffness_n_per_m)),
            Err(Error::Input(_) | Error::Solver { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    }

    fn estimator<'a>(&'a self, conditions: &'a PressConditions) -> ErrorEstimator<'a> {
        ErrorEstimator {
            session: &self.session,
            samples: self.session.samples(),
            conditions,
        }
    }

    fn conditions(&self) -> PressConditions {
        PressConditions {
            radius_m: self.session.unit() * self.session.radius(),
            ..PressConditions::default()
        }
    }
}
