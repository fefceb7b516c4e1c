//! Checks that the precision of an engine resolves the deformation under the loads of a scene.

use super::Scene;
use super::simulator::SimulatorSetup;
use crate::gpu::Gpu;
use crate::physics::grid::GridShape;
use crate::physics::{Engine, EngineChoice, SolverKind};
use crate::{Error, Result};

/// Largest [`ForceBalance::rounding_error`](crate::physics::ForceBalance::rounding_error) at which
/// displacements are right to 1 % on engines that store positions in single precision: measured
/// ones are off by 0.2 % at 0.01, 0.6 % at 0.06 and 1.2 % at 0.1 (limbs of 640 to 9,000 nodes;
/// `stiffness_and_load` in the tests of physics).
const MAX_ROUNDING_ERROR: f64 = 0.05;

impl SimulatorSetup {
    /// Returns the relative error of displacements due to rounding, if it is too large.
    fn excessive_rounding(&self) -> Result<Option<f64>> {
        let Some(balance) = self.simulator.force_balance()? else {
            return Ok(None);
        };
        let error = balance.rounding_error();
        Ok((error > MAX_ROUNDING_ERROR).then_some(error))
    }

    /// Checks that the engine resolves the deformation under the loads at rest; moves a body whose
    /// engine was chosen automatically to the CPU, with a note. `grid` is the shape of a grid body.
    ///
    /// # Errors
    /// [`Error::Input`] if it does not.
    pub(super) fn with_resolved_loads(
        self,
        gpu: &Gpu,
        (scene, grid): (&Scene, Option<GridShape>),
        kind: SolverKind,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        let engine = self.simulator.engine();
        if engine == Engine::Cpu {
            return Ok(self);
        }
        let Some(error) = self.excessive_rounding()? else {
            return Ok(self);
        };
        let what = format!(
            "the stiffness of the body makes displacements too small for the single precision of the engine {engine} (estimated rounding error: {error:.2} of the loads)"
        );
        let chosen = scene.solver.engine.unwrap_or_default();
        if chosen != EngineChoice::Auto || (self.simulator.model().is_none() && grid.is_none()) {
            return Err(Error::Input(format!("{what}; use --engine cpu")));
        }
        let mut moved = scene.clone();
        moved.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
        let mesh = self.simulator.mesh().clone();
        let (setup, others) = SimulatorSetup::new(gpu, &moved, kind, mesh, grid)?;
        *notes = others;
        notes.push(format!("{what}; it runs on the engine cpu"));
        Ok(setup)
    }
}
