//! Checks that the precision of an engine resolves the deformation under the loads of a scene.

use super::Scene;
use super::simulator::SimulatorSetup;
use crate::gpu::Gpu;
use crate::physics::{Engine, EngineChoice, SolverKind};
use crate::{Error, Result};

/// Largest ratio of the rounding error of nodal forces to the loads at which displacements are
/// right to about 1 % on engines that store positions in single precision
/// (`stiffness_and_load` in the tests of physics).
const MAX_ROUNDING_RATIO: f64 = 0.1;

impl SimulatorSetup {
    /// Returns the ratio of the rounding error of nodal forces to the loads, if it is too large.
    fn excessive_rounding(&self) -> Result<Option<f64>> {
        let Some(balance) = self.simulator.force_balance()? else {
            return Ok(None);
        };
        let ratio = balance.rounding / balance.scale;
        Ok((balance.scale > 0.0 && ratio > MAX_ROUNDING_RATIO).then_some(ratio))
    }

    /// Checks that the engine resolves the deformation under the loads at rest; moves a body whose
    /// engine was chosen automatically to the CPU, with a note.
    ///
    /// # Errors
    /// [`Error::Input`] if it does not.
    pub(super) fn with_resolved_loads(
        self,
        gpu: &Gpu,
        scene: &Scene,
        kind: SolverKind,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        let engine = self.simulator.engine();
        if engine == Engine::Cpu {
            return Ok(self);
        }
        let Some(ratio) = self.excessive_rounding()? else {
            return Ok(self);
        };
        let what = format!(
            "the stiffness of the body makes displacements too small for the single precision of the engine {engine} (rounding is {ratio:.2} of the loads)"
        );
        let chosen = scene.solver.engine.unwrap_or_default();
        if chosen != EngineChoice::Auto || self.simulator.network().is_none() {
            return Err(Error::Input(format!("{what}; use --engine cpu")));
        }
        let mut moved = scene.clone();
        moved.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
        let mesh = self.simulator.mesh().clone();
        let (setup, others) = SimulatorSetup::new(gpu, &moved, kind, mesh, None)?;
        *notes = others;
        notes.push(format!("{what}; it runs on the engine cpu"));
        Ok(setup)
    }
}
