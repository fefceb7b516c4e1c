//! How a motion is made: by which solver, in which steps, or by rapier.

use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    ConjugateGradients, Engine, EngineChoice, Loads, Material, Simulator, SolverKind, SpringNetwork,
};

/// What rapier is called beside solvers.
pub const RAPIER: &str = "rapier";

/// How a motion is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Which solver.
    pub kind: SolverKind,
    /// Steps in each of the spans.
    pub steps: u32,
    /// Where conjugate gradients stop: the residual, and the iterations.
    pub cg: Option<(f64, u32)>,
    /// Whether rapier makes it, by its own implicit Euler.
    pub rapier: bool,
}

impl Setting {
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
pub fn by_rapier(
    gpu: &Gpu,
    (mesh, network): &(TetMesh, SpringNetwork),
    material: &Material,
) -> Option<Box<dyn Simulator>> {
    let choice = EngineChoice::This(Engine::Rapier);
    let how = (SolverKind::Implicit, ConjugateGradients::default());
    let made = choice.tets_of(gpu, (mesh.clone(), network.clone()), material, how);
    made.ok()
}

/// Pins and pulls another body of the same nodes in the same way.
pub fn same_loads(from: &Loads, to: &mut Loads) -> Result<()> {
    let pinned = (0u32..).zip(from.pinned()).filter(|(_, pinned)| **pinned);
    to.pin_nodes(&pinned.map(|(i, _)| i).collect::<Vec<_>>())?;
    to.set_forces(from.forces())?;
    to.set_gravity(from.gravity());
    Ok(())
}
