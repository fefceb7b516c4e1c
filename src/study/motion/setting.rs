//! How a motion is made: by which solver, in which steps, or by rapier.

use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    CgSettings, DiscreteModel, Engine, EngineChoice, Loads, Material, Simulator, SolverKind,
};

/// What rapier is called beside solvers.
pub const RAPIER: &str = "rapier";

/// How a motion is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSetting {
    /// Which solver.
    pub kind: SolverKind,
    /// Steps in each of the spans.
    pub steps: u32,
    /// Where conjugate gradients stop: the residual, and the iterations.
    pub cg: Option<(f64, u32)>,
    /// Whether rapier makes it, by its own implicit Euler.
    pub rapier: bool,
}

impl MotionSetting {
    /// What it is called beside others: the solver, or rapier.
    pub fn name(&self) -> &'static str {
        match self.rapier {
            true => RAPIER,
            false => self.kind.name(),
        }
    }
}

/// The body of a mesh and its network by rapier; none of matter that it cannot have, and in builds
/// without it.
pub fn rapier_simulator(
    gpu: &Gpu,
    (mesh, network): &(TetMesh, DiscreteModel),
    material: &Material,
) -> Option<Box<dyn Simulator>> {
    let choice = EngineChoice::Exactly(Engine::Rapier);
    let how = (SolverKind::Implicit, CgSettings::default());
    let made = choice.build_tets_from_model(gpu, (mesh.clone(), network.clone()), material, how);
    made.ok()
}

/// Pins and pulls another body of the same nodes in the same way.
pub fn copy_loads(from: &Loads, to: &mut Loads) -> Result<()> {
    let pinned = (0u32..).zip(from.pinned()).filter(|(_, pinned)| **pinned);
    to.pin_nodes(&pinned.map(|(i, _)| i).collect::<Vec<_>>())?;
    to.set_forces(from.forces())?;
    to.set_gravity(from.gravity());
    Ok(())
}
