//! A state of the press of a session, solved again on finer and finer meshes: for maps and interactive
//! presses.

use super::error::LoadedState;
use super::refined::Refinement;
use super::session::PressSession;
use crate::accuracy::{
    ErrorParts, MAX_RAISED_TETS, Refinable, RestBody, Round, Solution, recovery_errors, refine,
};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::SolverKind;
use crate::progress::ProgressScope;
use crate::scene::{AccuracyEntry, Motion, OrderChoice};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// Steps to the depth of a state that does not follow from the one on the mesh before.
const STEPS: u32 = 16;

/// A state of a press, and its body.
#[derive(Clone, Copy)]
pub(super) struct StateToRefine<'a> {
    pub session: &'a PressSession,
    pub body: &'a RestBody,
    pub state: &'a LoadedState,
    /// Whether the order of the elements may be raised.
    pub may_raise: bool,
}

/// Called after each round but the first, with its number and the last change of the force, N.
type OnRound<'a> = &'a mut dyn FnMut(&Round, f64) -> Result<()>;

/// Solves a state of a press again on finer meshes, until its force is as exact as `wanted`. Returns the
/// last mesh, and the meshes on the way.
///
/// # Errors
/// [`Error::Input`] for a body whose error cannot be estimated; [`Error::Cancelled`]; errors of
/// `on_round`.
pub(super) fn refine_state(
    gpu: &Gpu,
    first: StateToRefine<'_>,
    wanted: &AccuracyEntry,
    on_round: OnRound<'_>,
    progress: ProgressFn,
) -> Result<(TetMesh, Refinement)> {
    let mut body = RefinedState {
        gpu,
        first,
        on_round,
        stage: ProgressScope::begin(progress, "refining the mesh", 0.0)?,
        change: 0.0,
    };
    let refined = refine(&mut body, first.body.mesh().clone(), wanted, progress)?;
    Ok(Refinement::new(refined, first.state.depth, body.change))
}

/// Returns the parts of the error of the force in `round`, whose last change was `change` (N), on a
/// mesh finer than that whose error has the parts `first`.
pub(super) fn error_parts(round: &Round, change: f64, first: &ErrorParts) -> ErrorParts {
    ErrorParts {
        mesh: round.error.unwrap_or(f64::INFINITY),
        time: 0.0,
        solver: change,
        ..*first
    }
}

/// A state of a press, on one mesh after the other.
struct RefinedState<'a> {
    gpu: &'a Gpu,
    first: StateToRefine<'a>,
    on_round: OnRound<'a>,
    stage: ProgressScope<'a>,
    /// The last change of the force, N.
    change: f64,
}

impl RefinedState<'_> {
    /// Places the fingertip at the depth of the state in a body with the positions `start`, until its
    /// force settles. Returns it.
    fn settle_from(
        &mut self,
        (session, motion): (&PressSession, &mut Motion),
        start: &[DVec3],
    ) -> Result<f64> {
        let (stage, depth) = (&self.stage, self.first.state.depth);
        let check = &mut || stage.check_cancelled();
        let [force, change] = session.settle_at(motion, start, depth, check)?;
        self.change = change;
        Ok(force)
    }

    /// Presses on the body at rest, step by step. Returns the force.
    fn press_from_rest(&self, session: &mut PressSession, motion: &mut Motion) -> Result<f64> {
        session.begin_again(motion)?;
        let begin = session.depth().unwrap_or(0.0);
        let end = self.first.state.depth;
        let mut force = f64::NAN;
        for step in 1..=STEPS {
            self.stage.check_cancelled()?;
            let goal = begin + (end - begin) * f64::from(step) / f64::from(STEPS);
            let Some(sample) = session.press_to(motion, goal, "load")? else {
                return Err(Error::Input(
                    "tets would be inverted; press less deep, or with a larger radius".into(),
                ));
            };
            force = sample.force_n;
        }
        Ok(force)
    }
}

impl Refinable for RefinedState<'_> {
    fn solve(&mut self, mesh: &TetMesh, start: Option<&[DVec3]>) -> Result<Solution> {
        let mut session = self.first.session.on_mesh(mesh)?;
        let new_motion = |session: &PressSession| {
            let (scene, kind) = (&session.setup().scene, SolverKind::Implicit);
            let (mut motion, _) = Motion::new(self.gpu, scene, kind, mesh.clone(), None)?;
            motion.set_sleep_allowed(false);
            Ok::<_, Error>(motion)
        };
        let mut motion = new_motion(&session)?;
        let Some(start) = start else {
            let StateToRefine { body, state, .. } = self.first;
            if !body.has_loads_of(&motion, session.setup().tool)? {
                return Err(Error::Input(
                    "a body is refined with the supports and loads of its scene, but others were set since"
                        .into(),
                ));
            }
            return Ok(Solution {
                value: state.force,
                positions: state.positions.clone(),
                errors: recovery_errors(&motion, &state.positions)?,
                stopped: None,
            });
        };
        let value = match self.settle_from((&session, &mut motion), start) {
            Err(Error::Solver { .. }) => {
                motion = new_motion(&session)?;
                self.press_from_rest(&mut session, &mut motion)?
            }
            settled => settled?,
        };
        let positions = motion.positions()?;
        Ok(Solution {
            value,
            errors: recovery_errors(&motion, &positions)?,
            positions,
            stopped: None,
        })
    }

    fn may_raise_order(&self, mesh: &TetMesh) -> bool {
        let mut scene = self.first.session.setup().scene.clone();
        scene.material.order = Some(OrderChoice::Auto);
        self.first.may_raise && scene.supports_order_2(mesh, MAX_RAISED_TETS)
    }

    fn after(&mut self, round: &Round, _: &TetMesh) -> Result<()> {
        match round.error {
            Some(_) => (self.on_round)(round, self.change),
            None => Ok(()),
        }
    }
}
