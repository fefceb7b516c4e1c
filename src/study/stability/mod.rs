//! `study stability`: stability and accuracy of each solver over step size and stiffness, with the
//! theoretical limit, and where methods fail.

mod cell;
mod default;
mod maps;
mod volume;

use super::Run;
use crate::Result;
use std::path::Path;

/// Maps the paper's bar and a hollow body with slivers, or in its place the named mesh or scene;
/// then measures volume preservation of the material models, and the defaults.
///
/// # Errors
/// An error if a mesh cannot be read, a measurement or writing fails, or `stability.csv` is from
/// another version of this study.
pub fn run(run: &Run, named: Option<&Path>) -> Result<()> {
    maps::run(run, named)?;
    volume::run(run)?;
    default::run(run)
}
