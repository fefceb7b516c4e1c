//! Output formats of meshes.

use super::ten_node::FileMesh;
use super::{abaqus_write, gmsh_write, medit_write, tetgen_write, vtk_legacy_write, vtu_write};
use crate::mesh::{Field, Location, TetMesh};
use crate::{Error, Result};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// An output format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// VTK XML unstructured grid (`.vtu`), compressed.
    Vtu,
    /// Legacy VTK, version 3 (`.vtk`).
    Vtk,
    /// Gmsh MSH 4.1 (`.msh`).
    Gmsh41,
    /// Gmsh MSH 2.2 (`.msh`).
    Gmsh22,
    /// Medit (`.mesh`), text.
    Medit,
    /// TetGen `.node` and `.ele`, text; either may be given.
    Tetgen,
    /// Abaqus (`.inp`), text.
    Abaqus,
}

/// Every format with its name and its extensions. An extension of several formats denotes the
/// first.
const FORMATS: [(MeshFormat, &str, &[&str]); 7] = [
    (MeshFormat::Vtu, "vtu", &["vtu"]),
    (MeshFormat::Vtk, "vtk", &["vtk"]),
    (MeshFormat::Gmsh41, "gmsh41", &["msh"]),
    (MeshFormat::Gmsh22, "gmsh22", &["msh"]),
    (MeshFormat::Medit, "medit", &["mesh"]),
    (MeshFormat::Tetgen, "tetgen", &["node", "ele"]),
    (MeshFormat::Abaqus, "abaqus", &["inp"]),
];

impl MeshFormat {
    /// Returns the format of the extension of `path`; 4.1 for `.msh`.
    ///
    /// # Errors
    /// An error for an unknown extension.
    pub fn from_extension(path: impl AsRef<Path>) -> Result<MeshFormat> {
        let path = path.as_ref();
        let extension = super::extension(path);
        if super::is_pieces(path) {
            return Err(Error::Input(format!(
                "{}: writing a mesh in pieces (.pvtu) requires their number; set --pieces N of \
                `palpate mesh` or `palpate convert`",
                path.display()
            )));
        }
        let found = FORMATS
            .iter()
            .find(|(.., extensions)| extensions.contains(&extension.as_str()));
        found.map(|f| f.0).ok_or_else(|| {
            Error::Input(format!(
                "{}: unsupported mesh extension \".{extension}\"; use .vtu, .vtk, .msh (Gmsh), \
                .mesh (Medit), .node with .ele (TetGen) or .inp (Abaqus)",
                path.display()
            ))
        })
    }

    /// Returns the extensions of its files.
    pub fn extensions(self) -> &'static [&'static str] {
        FORMATS
            .iter()
            .find(|(format, ..)| *format == self)
            .map_or(&[], |(.., extensions)| extensions)
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let found = FORMATS.iter().find(|(format, ..)| format == self);
        f.write_str(found.map_or("", |(_, name, _)| name))
    }
}

impl FromStr for MeshFormat {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<MeshFormat, String> {
        let found = FORMATS
            .iter()
            .find(|(_, name, _)| text.eq_ignore_ascii_case(name));
        found.map(|f| f.0).ok_or_else(|| {
            let names: Vec<&str> = FORMATS.iter().map(|(_, name, _)| *name).collect();
            format!("unknown format \"{text}\"; use one of {}", names.join(", "))
        })
    }
}

/// Writes a mesh in the format of the extension of `path` (see [`MeshFormat::from_extension`]),
/// atomically. VTK and Gmsh files are binary, the others text with all digits of a double.
///
/// A mesh of order 2 is written as ten-node tets, except to TetGen's files, which get the pieces; of a
/// cell field each ten-node tet gets the mean of its pieces by volume, of integers the first value.
///
/// `.vtu` is lossless: a written mesh reads back identical (node fields first, then cell fields; a
/// field whose values its number type cannot represent is written as Float64). The other formats
/// store nodes, tets, regions with their names, the unit of length, and the fields that they
/// support. Returns the data that the format cannot store, one sentence each.
///
/// # Errors
/// An error for another extension, for a mesh with invalid fields, or if the file cannot be
/// written.
pub fn write(path: impl AsRef<Path>, mesh: &TetMesh) -> Result<Vec<String>> {
    let path = path.as_ref();
    write_as(path, mesh, MeshFormat::from_extension(path)?, false)
}

/// Writes a mesh as [`write()`] does, in this format; VTK legacy and Gmsh as `text` on request.
///
/// # Errors
/// As [`write()`]; an error for the extension of another format, and for `text` of a `.vtu`.
pub fn write_as(
    path: impl AsRef<Path>,
    mesh: &TetMesh,
    format: MeshFormat,
    text: bool,
) -> Result<Vec<String>> {
    let path = path.as_ref();
    if !format
        .extensions()
        .contains(&super::extension(path).as_str())
    {
        return Err(Error::Input(format!(
            "{}: files of format {format} must have the extension .{}",
            path.display(),
            format.extensions().join(" or .")
        )));
    }
    check(mesh)?;
    let file_mesh = || FileMesh::new(mesh);
    match format {
        MeshFormat::Vtu if text => Err(Error::Input(format!(
            "{}: .vtu cannot be written as text; use legacy VTK (.vtk)",
            path.display()
        ))),
        MeshFormat::Vtu => vtu_write::write(path, mesh, &mesh.nodes, &[]).map(|()| Vec::new()),
        MeshFormat::Vtk => vtk_legacy_write::write(path, &file_mesh(), text),
        MeshFormat::Gmsh41 => gmsh_write::write(path, &file_mesh(), 4, text),
        MeshFormat::Gmsh22 => gmsh_write::write(path, &file_mesh(), 2, text),
        MeshFormat::Medit => medit_write::write(path, &file_mesh()),
        MeshFormat::Tetgen => tetgen_write::write(path, mesh),
        MeshFormat::Abaqus => abaqus_write::write(path, &file_mesh()),
    }
}

/// Checks that the fields fit the mesh and the tets its nodes, since a mesh may be built by hand.
fn check(mesh: &TetMesh) -> Result<()> {
    for field in &mesh.fields {
        let items = match field.location {
            Location::Node => mesh.nodes.len(),
            Location::Cell => mesh.tets.len(),
        };
        if field.components == 0 || items.checked_mul(field.components) != Some(field.values.len())
        {
            return Err(Error::Mesh(format!(
                "field \"{}\" has {} values, which does not match {items} {} of {} components",
                field.name,
                field.values.len(),
                field.location,
                field.components
            )));
        }
    }
    let node = mesh.tets.iter().flatten().max().copied().unwrap_or(0);
    if node as usize >= mesh.nodes.len() {
        return Err(Error::Mesh(format!(
            "a tet refers to node {node}, but there are only {} nodes (counted from 0)",
            mesh.nodes.len()
        )));
    }
    if i32::try_from(mesh.nodes.len().max(mesh.tets.len())).is_err() {
        return Err(Error::Mesh(
            "number of nodes and number of tets must be less than 2³¹".into(),
        ));
    }
    Ok(())
}

/// Returns the sentence that lists the fields a format cannot store, if there are any.
pub(super) fn dropped_fields_note(fields: &[&Field], why: &str) -> Option<String> {
    let named: Vec<String> = fields
        .iter()
        .map(|f| format!("\"{}\" ({})", f.name, f.location))
        .collect();
    (!named.is_empty()).then(|| format!("fields not written: {}; {why}", named.join(", ")))
}

/// Removes line ends and control characters from `text`, which names in text formats cannot
/// contain.
pub(super) fn one_line(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}
