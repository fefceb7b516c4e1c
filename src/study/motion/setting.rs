//! Settings of a motion: the solver, the steps, or Rapier.

use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    CgSettings, DiscreteModel, Engine, EngineChoice, Loads, Material, Simulator, SolverKind,
};

/// Name of Rapier in the list of solvers.
pub const RAPIER: &str = "rapier";

/// Settings of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSetting {
    /// The solver.
    pub kind: SolverKind,
    /// Number of steps in each interval.
    pub steps: u32,
    /// Stopping criteria of conjugate gradients: the residual and the iterations.
    pub cg: Option<(f64, u32)>,
    /// Whether Rapier computes it, with its own implicit Euler.
    pub rapier: bool,
}

impl MotionSetting {
    /// Returns the display name: the solver, or Rapier.
    pub fn name(&self) -> &'static str {
        match self.rapier {
            true => RAPIER,
            false => self.kind.name(),
        }
    }
}

/// Returns the body of a mesh and its model in Rapier; none for a material that it does not
/// support, and in builds without Rapier.
pub fn rapier_simulator(
    gpu: &Gpu,
    (mesh, model): &(TetMesh, DiscreteModel),
    material: &Material,
) -> Option<Box<dyn Simulator>> {
    let choice = EngineChoice::Exactly(Engine::Rapier);
    let how = (SolverKind::Implicit, CgSettings::default());
    let made = choice.build_tets_from_model(gpu, (mesh.clone(), model.clone()), material, how);
    made.ok()
}

/// Copies pins and forces to another body with the same nodes.
pub fn copy_loads(from: &Loads, to: &mut Loads) -> Result<()> {
    let pinned = (0u32..).zip(from.pinned()).filter(|(_, pinned)| **pinned);
    to.pin_nodes(&pinned.map(|(i, _)| i).collect::<Vec<_>>())?;
    to.set_forces(from.forces())?;
    to.set_gravity(from.gravity());
    Ok(())
}
