//! `palpate convert A B`: a mesh or a surface in another format.

use super::mesh::is_surface;
use super::{Outcome, tell};
use clap::Args;
use palpate::io::{self, Kind, MeshFormat};
use palpate::{Error, Result};
use std::path::{Path, PathBuf};

/// Arguments of `convert`.
#[derive(Args)]
pub struct ConvertArguments {
    /// A mesh (.vtk, .vtu, .msh, .node or .ele, .mesh, .inp) or a surface (.stl, .ply, .obj, .vtk)
    input: PathBuf,
    /// The mesh (.vtu, .vtk, .msh, .mesh, .node with .ele, .inp) or surface (.ply, .obj, .stl);
    /// what its format has no place for is named
    output: PathBuf,
    /// vtu, vtk, gmsh41, gmsh22, medit, tetgen or abaqus; default: by the extension, gmsh41 for
    /// .msh
    #[arg(long)]
    format: Option<MeshFormat>,
    /// Write text where the format is usually binary (.vtk, .msh)
    #[arg(long)]
    text: bool,
}

/// Reads the one and writes the other.
pub fn run(arguments: &ConvertArguments) -> anyhow::Result<Outcome> {
    let (input, output) = (&arguments.input, &arguments.output);
    match is_surface(output) {
        true => surface(arguments)?,
        false => {
            let format = match arguments.format {
                Some(format) => format,
                None => MeshFormat::of(output)?,
            };
            refuse_others(input)?;
            let mesh = io::read(input)?;
            tell(&mesh.repairs.warnings);
            tell(&io::write_as(output, &mesh, format, arguments.text)?);
        }
    }
    Ok(Outcome::Done)
}

fn surface(arguments: &ConvertArguments) -> Result<()> {
    let (input, output) = (&arguments.input, &arguments.output);
    if arguments.format.is_some() || arguments.text {
        return Err(Error::Input(format!(
            "{}: --format and --text are for meshes; a surface's format is its extension",
            output.display()
        )));
    }
    if io::kind(input)? != Kind::Surface {
        return Err(Error::format(
            input,
            format!(
                "this is no surface; `palpate mesh {} --out {}` makes one of a mesh or volume",
                input.display(),
                output.display()
            ),
        ));
    }
    let surface = io::read_surface(input)?;
    tell(&surface.notes);
    let fields: Vec<String> = surface
        .fields
        .iter()
        .map(|field| format!("\"{}\"", field.name))
        .collect();
    let is_ply = output
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("ply"));
    if !fields.is_empty() && !is_ply {
        tell(&[format!(
            "only .ply holds scalars of vertices: of {} no more is written than the format has a place for",
            fields.join(", ")
        )]);
    }
    io::write_surface(output, &surface)
}

/// Says what to do with a file that holds no mesh.
fn refuse_others(input: &Path) -> Result<()> {
    let what = match io::kind(input)? {
        Kind::Mesh => return Ok(()),
        Kind::Surface => "a surface, which has no tets",
        Kind::Volume => "a volume",
    };
    Err(Error::format(
        input,
        format!(
            "this is {what}; `palpate mesh {} --out MESH` makes a mesh of it",
            input.display()
        ),
    ))
}
