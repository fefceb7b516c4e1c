//! `study stability`: what becomes of each solver over step size and stiffness, with the limit of
//! theory drawn over it, and where methods fail.

mod cell;
mod maps;
mod volume;

use super::Run;
use crate::Result;
use std::path::Path;

/// Maps of the paper's bar and of a real heart, and the force that keeps volume. It takes no
/// scene: the bodies are those of the paper and of the maps.
///
/// # Errors
/// What measuring and writing return; `stability.csv` of another version of this study.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    if let Some(scene) = scene {
        run.note(&format!(
            "the study of stability has bodies of its own; {} is passed over",
            scene.display()
        ));
    }
    maps::run(run)?;
    volume::run(run)
}
