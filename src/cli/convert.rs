//! `palpate convert A B`: converts a mesh or a surface to another format.

use super::mesh::is_surface;
use super::{Outcome, print_json, print_notes};
use clap::Args;
use palpate::io::{self, Kind, MeshFormat};
use palpate::scene::write_pieces;
use palpate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Arguments of `convert`.
#[derive(Args)]
pub struct ConvertArguments {
    /// Mesh (.vtk, .vtu, .pvtu, .msh, .node or .ele, .mesh, .inp) or a surface (.stl, .ply, .obj,
    /// .vtk)
    input: PathBuf,
    /// Output mesh (.vtu, .vtk, .msh, .mesh, .node with .ele, .inp; .pvtu with --pieces) or surface
    /// (.ply, .obj, .stl); data the format cannot store is listed on standard error
    output: PathBuf,
    /// Write the mesh in this number of pieces, partitioned by a k-d tree: OUTPUT, a .pvtu, lists
    /// them, and each is a .vtu in its folder that can be rendered separately (docs/how-to/clusters.md)
    #[arg(long, value_name = "N", conflicts_with_all = ["format", "text"])]
    pieces: Option<usize>,
    /// Select the format: vtu, vtk, gmsh41, gmsh22, medit, tetgen or abaqus [default: from the
    /// extension, gmsh41 for .msh]
    #[arg(long)]
    format: Option<MeshFormat>,
    /// Write text instead of binary (.vtk, .msh)
    #[arg(long)]
    text: bool,
    /// Print a report of the written and the dropped data on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Reads the input and writes the output.
pub fn run(arguments: &ConvertArguments) -> anyhow::Result<Outcome> {
    let (input, output) = (&arguments.input, &arguments.output);
    let report = match is_surface(output) {
        true => surface(arguments)?,
        false => {
            let format = match (arguments.format, arguments.pieces) {
                (Some(format), _) => Some(format),
                (None, pieces) => format_of(output, pieces)?,
            };
            refuse_others(input)?;
            let mesh = io::read(input)?;
            let mut notes = mesh.repairs.warnings.clone();
            print_notes(&notes);
            match format {
                Some(format) => {
                    let left_out = io::write_as(output, &mesh, format, arguments.text)?;
                    print_notes(&left_out);
                    notes.extend(left_out);
                }
                None => write_pieces(output, &mesh, arguments.pieces.unwrap_or(1))?,
            }
            json!({
                "output": output.to_string_lossy(),
                "nodes": mesh.nodes.len(),
                "tets": mesh.element_count(),
                "pieces": arguments.pieces,
                "notes": notes,
            })
        }
    };
    if arguments.json {
        print_json(&report)?;
    }
    Ok(Outcome::Done)
}

/// Returns the format of a file name; `None` for an index of pieces.
pub fn format_of(path: &Path, pieces: Option<usize>) -> Result<Option<MeshFormat>> {
    match pieces {
        None => MeshFormat::from_extension(path).map(Some),
        Some(_) if io::is_pieces(path) => Ok(None),
        Some(_) => Err(Error::Input(format!(
            "{}: with --pieces the output must have the extension .pvtu (the index of the pieces)",
            path.display()
        ))),
    }
}

/// Writes a surface, and returns the report.
fn surface(arguments: &ConvertArguments) -> Result<Value> {
    let (input, output) = (&arguments.input, &arguments.output);
    if arguments.format.is_some() || arguments.text || arguments.pieces.is_some() {
        return Err(Error::Input(format!(
            "{}: --format, --text and --pieces require a mesh; the format of a surface is given by its extension",
            output.display()
        )));
    }
    if io::detect_kind(input)? != Kind::Surface {
        return Err(Error::format(
            input,
            format!(
                "not a surface; extract one from a mesh or volume with `palpate mesh {} --out {}`",
                input.display(),
                output.display()
            ),
        ));
    }
    let surface = io::read_surface(input)?;
    let mut notes = surface.notes.clone();
    let fields: Vec<String> = surface
        .fields
        .iter()
        .map(|field| format!("\"{}\"", field.name))
        .collect();
    let is_ply = output
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("ply"));
    if !fields.is_empty() && !is_ply {
        notes.push(format!(
            "only .ply stores vertex scalars; {} may be dropped by this format",
            fields.join(", ")
        ));
    }
    print_notes(&notes);
    io::write_surface(output, &surface)?;
    Ok(json!({
        "output": output.to_string_lossy(),
        "vertices": surface.vertices.len(),
        "triangles": surface.triangles.len(),
        "notes": notes,
    }))
}

/// Returns an error with advice for a file that contains no mesh.
fn refuse_others(input: &Path) -> Result<()> {
    let what = match io::detect_kind(input)? {
        Kind::Mesh => return Ok(()),
        Kind::Surface => "a surface, which has no tets",
        Kind::Volume => "a volume",
    };
    Err(Error::format(
        input,
        format!(
            "this is {what}; mesh it with `palpate mesh {} --out MESH`",
            input.display()
        ),
    ))
}
