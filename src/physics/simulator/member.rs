//! One of several bodies that are simulated as one.

use super::Simulator;
use crate::physics::Engine;
use crate::{Error, Result};
use serde::Serialize;

/// One of several bodies.
pub struct Member {
    /// Its name in messages and reports.
    pub name: String,
    /// The simulator of the body.
    pub simulator: Box<dyn Simulator>,
    /// The largest step of this body, s; longer steps are split into substeps.
    pub step: f64,
}

/// Report of one of several bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemberReport {
    /// Its name.
    pub name: String,
    /// The engine that computes its steps.
    pub engine: Engine,
    /// The solver, named as on the command line.
    pub solver: &'static str,
    /// Number of tets of its mesh.
    pub tets: usize,
    /// Number of nodes of its mesh.
    pub nodes: usize,
    /// Substeps per step of the whole.
    pub steps: u32,
}

impl Member {
    /// Reports it, for a common step of `dt` seconds.
    pub fn report(&self, dt: f64) -> MemberReport {
        let simulator = self.simulator.as_ref();
        MemberReport {
            name: self.name.clone(),
            engine: simulator.engine(),
            solver: simulator.integrator().name(),
            tets: simulator.mesh().tets.len(),
            nodes: simulator.mesh().nodes.len(),
            steps: self.steps(dt),
        }
    }

    /// Substeps in a step of `dt` seconds.
    pub(in crate::physics) fn steps(&self, dt: f64) -> u32 {
        // A step that exceeds the largest only by rounding is not split.
        let steps = (dt / self.step * (1.0 - 1e-9)).ceil();
        (steps as u32).max(1)
    }

    /// Calls `of` with the simulator; prefixes errors with the body's name.
    pub(in crate::physics) fn named<T>(
        &mut self,
        of: impl FnOnce(&mut dyn Simulator) -> Result<T>,
    ) -> Result<T> {
        of(self.simulator.as_mut()).map_err(|e| self.name_error(e))
    }

    /// Prefixes the error of `given`, if any, with the body's name.
    pub(in crate::physics) fn with_body_name<T>(&self, given: Result<T>) -> Result<T> {
        given.map_err(|e| self.name_error(e))
    }

    pub(in crate::physics) fn name_error(&self, error: Error) -> Error {
        let name = &self.name;
        match error {
            Error::Input(what) => Error::Input(format!("body \"{name}\": {what}")),
            Error::Solver {
                solver,
                step,
                time,
                cause,
                what,
                advice,
            } => Error::Solver {
                solver,
                step,
                time,
                cause,
                what: format!("body \"{name}\": {what}"),
                advice,
            },
            other => other,
        }
    }
}
