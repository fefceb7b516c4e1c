//! `palpate presets`: the transfer functions by name.

use super::Outcome;
use clap::Args;
use palpate::annotate::preset_sheet;
use palpate::render::TransferFunction;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `presets`.
#[derive(Args)]
pub struct PresetsArguments {
    /// Draws a sheet of all of them: a picture, .png
    #[arg(long, short)]
    out: Option<PathBuf>,
}

/// Lists the presets, or draws them.
pub fn run(arguments: &PresetsArguments) -> anyhow::Result<Outcome> {
    match &arguments.out {
        Some(path) => preset_sheet()?.save(path)?,
        None => {
            let mut out = std::io::stdout().lock();
            for name in TransferFunction::preset_names() {
                writeln!(out, "{name}")?;
            }
        }
    }
    Ok(Outcome::Done)
}
