//! The solver kinds and their names.

use crate::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// The kind of a solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SolverKind {
    /// `explicit`: explicit Euler.
    Explicit,
    /// `symplectic`: symplectic (semi-implicit) Euler.
    Symplectic,
    /// `verlet`: the original Verlet scheme.
    Verlet,
    /// `velocity-verlet`: velocity Verlet.
    VelocityVerlet,
    /// `implicit`: implicit Euler after Baraff & Witkin; for finite elements, minimised by Newton's
    /// method.
    Implicit,
    /// `bdf2`: the second-order backward differentiation formula, for finite elements. Damps high
    /// frequencies.
    Bdf2,
    /// `midpoint`: the implicit midpoint rule, for finite elements: second order, preserves the
    /// energy of oscillations.
    Midpoint,
}

impl SolverKind {
    /// The solvers available for every tetrahedral body.
    pub const ALL: [SolverKind; 5] = [
        SolverKind::Explicit,
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
        SolverKind::Implicit,
    ];

    /// The solvers available for finite elements only.
    pub const ELEMENT_ONLY: [SolverKind; 2] = [SolverKind::Bdf2, SolverKind::Midpoint];

    /// Whether it is stable for any step.
    pub fn is_implicit(self) -> bool {
        matches!(
            self,
            SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint
        )
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
                "unknown solver \"{name}\"; expected one of {}",
                names.join(", ")
            ))
        })
    }
}
