//! `palpate info FILE`: prints statistics and problems of a file.

use super::{Outcome, print_json};
use clap::Args;
use palpate::io::{self, Kind};
use palpate::mesh::{MeshDescription, SurfaceDescription};
use palpate::volume::VolumeDescription;
use std::fmt::Display;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `info`.
#[derive(Args)]
pub struct InfoArguments {
    /// Mesh (.vtk, .vtu, .msh, .node or .ele, .mesh, .inp), volume (.nii, .nii.gz, .nrrd, .nhdr,
    /// .mhd, .mha, a DICOM folder) or surface (.stl, .ply, .obj, .vtk)
    file: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints the description of the content of a file.
pub fn run(arguments: &InfoArguments) -> anyhow::Result<Outcome> {
    let file = &arguments.file;
    match io::detect_kind(file)? {
        Kind::Volume => print(&VolumeDescription::new(&io::read_volume(file)?), arguments),
        Kind::Surface => print(
            &SurfaceDescription::new(&io::read_surface(file)?),
            arguments,
        ),
        Kind::Mesh => print(&MeshDescription::new(&io::read(file)?), arguments),
    }
}

fn print(
    description: &(impl Display + serde::Serialize),
    arguments: &InfoArguments,
) -> anyhow::Result<Outcome> {
    match arguments.json {
        true => print_json(description)?,
        false => write!(std::io::stdout().lock(), "{description}")?,
    }
    Ok(Outcome::Done)
}
