//! The error of the present force of an interactive press.

use super::curve::PressConditions;
use super::error::{ComparedBodies, ErrorEstimator, LoadedState, WHAT};
use super::session::{PressSession, not_placed};
use crate::accuracy::{ErrorParts, RestBody};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, PIECES};
use crate::progress::ProgressScope;
use crate::scene::Motion;
use crate::{Error, ProgressFn, Result};

/// The present state of an interactive press, whose error can be estimated on another thread.
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

    /// Estimates the parts of the error of the force, N.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::Solver`] if the finer body has no equilibrium near this one.
    pub fn force_error(&self, gpu: &Gpu, progress: ProgressFn) -> Result<ErrorParts> {
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
        let found = estimator.correct(&mut bodies, (&self.state, slope), &mut || report(0.4))?;
        Ok(found.parts)
    }
}
