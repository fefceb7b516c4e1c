//! `palpate info FILE`: what is in it, what is wrong with it.

use super::Outcome;
use clap::Args;
use palpate::io;
use palpate::mesh::Description;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `info`.
#[derive(Args)]
pub struct InfoArguments {
    /// A mesh file: .vtk, .vtu, .msh, .node or .ele, .mesh
    file: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints the description of a mesh.
pub fn run(arguments: &InfoArguments) -> anyhow::Result<Outcome> {
    let description = Description::new(&io::read(&arguments.file)?);
    let mut out = std::io::stdout().lock();
    if arguments.json {
        writeln!(out, "{}", serde_json::to_string_pretty(&description)?)?;
    } else {
        write!(out, "{description}")?;
    }
    Ok(Outcome::Done)
}
