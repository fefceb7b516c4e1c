//! The error of the present force of an interactive press, and the force on finer meshes.

use super::curve::PressConditions;
use super::error::{ComparedBodies, ErrorEstimator, LoadedState, WHAT};
use super::refined_session::{StateToRefine, error_parts, refine_state};
use super::session::{PressSession, not_placed};
use crate::accuracy::{ErrorParts, RestBody, Round};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, PIECES};
use crate::progress::ProgressScope;
use crate::scene::{AccuracyEntry, Motion};
use crate::{Error, ProgressFn, Result};
use web_time::Instant;

/// The present state of an interactive press, whose force can be estimated on another thread.
#[derive(Clone, Debug)]
pub(super) struct PressedState {
    body: RestBody,
    session: PressSession,
    state: LoadedState,
}

impl PressedState {
    /// Returns the state of the press of `session` on the body of `motion`, which is at rest at the
    /// last sample.
    ///
    /// # Errors
    /// [`Error::Input`] without a press, or for a body whose error cannot be estimated; errors of
    /// reading the body back.
    pub fn new(session: &PressSession, motion: &Motion) -> Result<PressedState> {
        let last = session.samples().last();
        let (Some(last), Some(depth)) = (last, session.depth()) else {
            return Err(not_placed());
        };
        if !session.setup().quasi_static {
            return Err(Error::Input(
                "the error of a press is estimated for quasi-static presses only".into(),
            ));
        }
        Ok(PressedState {
            body: RestBody::new(&session.setup().scene, motion)?,
            session: session.clone(),
            state: LoadedState {
                depth,
                force: last.force_n,
                positions: motion.positions()?,
            },
        })
    }

    /// Returns the number of elements of the finer space, on which the computing time depends.
    pub fn finer_elements(&self) -> usize {
        let mesh = self.body.mesh();
        match mesh.order {
            ElementOrder::Linear => mesh.element_count(),
            ElementOrder::Quadratic => PIECES * mesh.element_count(),
        }
    }

    /// Calls `each` with the force and the parts of its error (N): on the present mesh, and on each of the
    /// finer ones until it is as exact as `wanted`, or cannot be.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::Solver`] if the finer body has no equilibrium near this one.
    pub fn force_estimates(
        &self,
        gpu: &Gpu,
        wanted: &AccuracyEntry,
        each: &mut dyn FnMut(&Round, &ErrorParts),
        progress: ProgressFn,
    ) -> Result<()> {
        let start = Instant::now();
        let first = self.force_error(gpu, progress)?;
        let mesh = self.body.mesh();
        let force = self.state.force;
        each(
            &Round {
                order: mesh.order.number(),
                elements: mesh.element_count(),
                nodes: mesh.nodes.len(),
                value: force,
                error: Some(first.mesh),
                seconds: start.elapsed().as_secs_f64(),
            },
            &first,
        );
        let is_exact = |share: f64| first.total() <= share * force.abs();
        if wanted.within.is_none_or(is_exact) {
            return Ok(());
        }
        let pressed = StateToRefine {
            session: &self.session,
            body: &self.body,
            state: &self.state,
            may_raise: self.session.setup().order_note().is_some(),
        };
        let mut on_round = |round: &Round, change: f64| {
            each(round, &error_parts(round, change, &first));
            Ok(())
        };
        refine_state(gpu, pressed, wanted, &mut on_round, progress).map(drop)
    }

    /// Estimates the parts of the error of the force, N.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::Solver`] if the finer body has no equilibrium near this one.
    fn force_error(&self, gpu: &Gpu, progress: ProgressFn) -> Result<ErrorParts> {
        let report = |share: f64| ProgressScope::begin(progress, WHAT, share).map(drop);
        report(0.0)?;
        let estimator = ErrorEstimator {
            session: &self.session,
            samples: self.session.samples(),
            conditions: &PressConditions::default(),
        };
        let mut bodies = ComparedBodies::new(gpu, &self.body, &self.session)?;
        report(0.2)?;
        let slope = estimator.slope(&self.state);
        let state = (&self.state, slope);
        let found = estimator.correct(&mut bodies, state, &mut || report(0.4))?;
        Ok(found.parts)
    }
}
