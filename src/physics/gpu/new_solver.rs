//! The solvers on the GPU, by name.

use crate::Result;
use crate::gpu::Gpu;
use crate::physics::simulator::messages::requires_elements_error;
use crate::physics::{
    ExplicitEuler, GpuBody, ImplicitEuler, Solver, SolverKind, SymplecticEuler, VelocityVerlet,
    Verlet,
};

impl SolverKind {
    /// A solver of this kind for `body`.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when its arrays do not fit the device; [`Error::Input`](crate::Error::Input) for one of
    /// [`SolverKind::ELEMENT_ONLY`].
    pub fn solver(self, gpu: &Gpu, body: &GpuBody) -> Result<Box<dyn Solver>> {
        Ok(match self {
            SolverKind::Explicit => Box::new(ExplicitEuler::new(gpu, body)?),
            SolverKind::Symplectic => Box::new(SymplecticEuler::new(gpu, body)?),
            SolverKind::Verlet => Box::new(Verlet::new(gpu, body)?),
            SolverKind::VelocityVerlet => Box::new(VelocityVerlet::new(gpu, body)?),
            SolverKind::Implicit => Box::new(ImplicitEuler::new(gpu, body)?),
            SolverKind::Bdf2 | SolverKind::Midpoint => return Err(requires_elements_error(self)),
        })
    }
}
