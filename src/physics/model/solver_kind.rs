//! The solvers by name.

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
    /// `implicit`: implicit Euler after Baraff & Witkin; of elements, minimised by Newton's method.
    Implicit,
    /// `bdf2`: the second backward differentiation formula, of elements, on the CPU: of second
    /// order, and it damps what is fast.
    Bdf2,
    /// `midpoint`: the implicit midpoint rule, of elements, on the CPU: of second order, and it
    /// keeps what swings.
    Midpoint,
}

impl SolverKind {
    /// Every solver that steps any body of tets.
    pub const ALL: [SolverKind; 5] = [
        SolverKind::Explicit,
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
        SolverKind::Implicit,
    ];

    /// Those that step bodies of finite elements only.
    pub const ELEMENT_ONLY: [SolverKind; 2] = [SolverKind::Bdf2, SolverKind::Midpoint];

    /// Whether any step of it is stable.
    pub fn is_implicit(self) -> bool {
        matches!(
            self,
            SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint
        )
    }

    /// The error of a body of springs, or of another engine, that is to be stepped by one of
    /// [`SolverKind::ELEMENT_ONLY`].
    pub(in crate::physics) fn requires_elements_error(self) -> Error {
        Error::Input(format!(
            "{self} steps bodies of finite elements on the CPU: give --material neo-hookean (or corotated) and --engine cpu, or take --solver implicit"
        ))
    }

    /// The name, as on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            SolverKind::Explicit => "explicit",
            SolverKind::Symplectic => "symplectic",
            SolverKind::Verlet => "verlet",
            SolverKind::VelocityVerlet => "velocity-verlet",
            SolverKind::Implicit => "implicit",
            SolverKind::Bdf2 => "bdf2",
            SolverKind::Midpoint => "midpoint",
        }
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
        let all = || SolverKind::ALL.into_iter().chain(SolverKind::ELEMENT_ONLY);
        all().find(|k| k.name() == name).ok_or_else(|| {
            let names: Vec<&str> = all().map(SolverKind::name).collect();
            Error::Input(format!(
                "there is no solver \"{name}\"; there are {}",
                names.join(", ")
            ))
        })
    }
}
