//! The solvers by name.

use super::{Body, ExplicitEuler, ImplicitEuler, Solver, SymplecticEuler, VelocityVerlet, Verlet};
use crate::gpu::Gpu;
use crate::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// Which solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SolverKind {
    /// `explicit`: explicit Euler.
    Explicit,
    /// `symplectic`: symplectic (semi-implicit) Euler.
    Symplectic,
    /// `verlet`: Verlet's own scheme.
    Verlet,
    /// `velocity-verlet`: velocity Verlet.
    VelocityVerlet,
    /// `implicit`: implicit Euler after Baraff & Witkin.
    Implicit,
}

impl SolverKind {
    /// Every solver.
    pub const ALL: [SolverKind; 5] = [
        SolverKind::Explicit,
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
        SolverKind::Implicit,
    ];

    /// The name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SolverKind::Explicit => "explicit",
            SolverKind::Symplectic => "symplectic",
            SolverKind::Verlet => "verlet",
            SolverKind::VelocityVerlet => "velocity-verlet",
            SolverKind::Implicit => "implicit",
        }
    }

    /// A solver of this kind for `body`.
    ///
    /// # Errors
    /// [`Error::Gpu`] when its arrays do not fit the device.
    pub fn solver(self, gpu: &Gpu, body: &Body) -> Result<Box<dyn Solver>> {
        Ok(match self {
            SolverKind::Explicit => Box::new(ExplicitEuler::new(gpu, body)?),
            SolverKind::Symplectic => Box::new(SymplecticEuler::new(gpu, body)?),
            SolverKind::Verlet => Box::new(Verlet::new(gpu, body)?),
            SolverKind::VelocityVerlet => Box::new(VelocityVerlet::new(gpu, body)?),
            SolverKind::Implicit => Box::new(ImplicitEuler::new(gpu, body)?),
        })
    }
}

impl fmt::Display for SolverKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SolverKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<SolverKind> {
        SolverKind::ALL
            .into_iter()
            .find(|k| k.name() == name)
            .ok_or_else(|| {
                let names: Vec<&str> = SolverKind::ALL.iter().map(|k| k.name()).collect();
                Error::Input(format!(
                    "there is no solver \"{name}\"; there are {}",
                    names.join(", ")
                ))
            })
    }
}
