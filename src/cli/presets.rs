//! `palpate presets`: lists the transfer function presets.

use super::{Outcome, print_json};
use clap::Args;
use palpate::annotate::preset_sheet;
use palpate::render::TransferFunction;
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `presets`.
#[derive(Args)]
pub struct PresetsArguments {
    /// Render a sheet of all presets to this file (.png)
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Print the list on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Lists or renders the presets.
pub fn run(arguments: &PresetsArguments) -> anyhow::Result<Outcome> {
    if let Some(path) = &arguments.out {
        preset_sheet()?.save(path)?;
    }
    let names = TransferFunction::preset_names();
    if arguments.json {
        print_json(&json!({ "presets": names }))?;
    } else if arguments.out.is_none() {
        let mut out = std::io::stdout().lock();
        for name in names {
            writeln!(out, "{name}")?;
        }
    }
    Ok(Outcome::Done)
}
