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
    /// Mesh (.vtk, .vtu, .msh, .node or .ele, .mesh, .inp), volume (.nii, .nii.gz, .hdr with .img,
    /// .nrrd, .nhdr, .mhd, .mha, .mgz, DICOM: a file or a folder of slices) or surface (.stl, .ply, .obj, .vtk)
    file: PathBuf,
    /// Select one of several volumes in the file (times, echoes, components), counted from 0
    #[arg(long, value_name = "K")]
    volume: Option<usize>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints the description of the content of a file.
pub fn run(arguments: &InfoArguments) -> anyhow::Result<Outcome> {
    let file = &arguments.file;
    let kind = io::detect_kind(file)?;
    if arguments.volume.is_some() && kind != Kind::Volume {
        anyhow::bail!(
            "--volume applies to volumes only, and {} is none; omit it",
            file.display()
        );
    }
    match kind {
        Kind::Volume => {
            let volume = io::read_volume_number(file, arguments.volume)?;
            print(&VolumeDescription::new(&volume), arguments)
        }
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
