//! `study stability`: what becomes of each solver over step size and stiffness, with the limit of
//! theory drawn over it, and where methods fail.

mod cell;
mod default;
mod maps;
mod volume;

use super::Run;
use crate::Result;
use std::path::Path;

/// Maps of the paper's bar and of a hollow body with slivers, or of the mesh (or a scene's mesh)
/// that is named in its place; what the models of matter do with volume; and the default.
///
/// # Errors
/// What reading a mesh, measuring and writing return; `stability.csv` of another version of this
/// study.
pub fn run(run: &Run, named: Option<&Path>) -> Result<()> {
    maps::run(run, named)?;
    volume::run(run)?;
    default::run(run)
}
