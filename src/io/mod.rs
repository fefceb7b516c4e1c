//! Readers and writers, one file per format. This module is independent of the GPU.
//!
//! Readers fill a raw mesh of cells of any type with fields; `cells` converts it to tets, and
//! [`TetMesh::new`] validates and repairs them. Every error states the position in the file; counts
//! in a file are checked against its length before they size an allocation.

mod abaqus;
mod abaqus_assembly;
mod abaqus_elements;
mod abaqus_include;
mod abaqus_lines;
mod abaqus_part;
mod abaqus_sets;
mod abaqus_write;
mod atomic;
mod cell_kinds;
mod content;
mod cursor;
mod format;
mod frames;
#[doc(hidden)]
pub mod fuzz;
mod gmsh;
mod gmsh_data;
mod gmsh_entities;
mod gmsh_kinds;
mod gmsh_source;
mod gmsh_write;
mod groups;
mod id_map;
mod join;
mod medit;
mod medit_write;
mod metadata;
mod mfem;
mod other_formats;
mod parse;
mod polyhedra;
mod pvd;
mod pvtu;
mod raw_mesh;
mod scalar;
mod surface;
mod ten_node;
mod tetgen;
mod tetgen_write;
mod ucd;
mod volume;
mod vtk_legacy;
mod vtk_legacy_attributes;
mod vtk_legacy_data;
mod vtk_legacy_names;
mod vtk_legacy_write;
mod vtk_regions;
mod vtk_xml;
mod vtu;
mod vtu_data;
mod vtu_tags;
mod vtu_write;

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use atomic::TempFile;
pub use atomic::atomic_write;
pub use format::{MeshFormat, write, write_as};
pub use frames::FrameStream;
pub use parse::{parse, parse_surface, parse_volume};
pub use pvd::{Frame, PvdSeries, read_pvd};
pub(crate) use pvtu::{PRIVATE_PREFIX, read_piece, write_pieces};
pub use pvtu::{is_pieces, piece_files};
pub use surface::{read_surface, write_surface};
pub(crate) use volume::{Layout, VolumeFormat, VolumeStream};
pub use volume::{read_volume, read_volume_number, write_volume};

use content::{content, content_of};

pub(crate) use crate::files::OutFile;
pub use crate::files::{exists, read_text};
#[cfg(target_arch = "wasm32")]
pub use crate::files::{insert_file, take_file};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use std::path::Path;

/// Formats supported by [`read`], for messages.
const READABLE_FORMATS: &str = "VTK legacy (.vtk), VTK XML (.vtu, .pvtu), Gmsh (.msh), TetGen (.node with .ele), Medit (.mesh), MFEM (.mesh), Abaqus (.inp) and AVS UCD (.inp)";

/// Reads a mesh in any supported format: VTK legacy, VTU, Gmsh 1 to 4.1, TetGen, Medit, MFEM,
/// Abaqus, AVS UCD; the pieces of a partitioned mesh (`.pvtu`) are merged. The format is detected from
/// the content, then from the extension. Files with ten-node tets give a mesh of order 2
/// ([`TetMesh::order`]). Changes (cells subdivided or dropped, repairs) are reported in
/// [`TetMesh::repairs`].
///
/// # Errors
/// An error if the file cannot be read, is damaged, or contains no volume.
pub fn read(path: impl AsRef<Path>) -> Result<TetMesh> {
    let path = path.as_ref();
    let raw = raw_mesh(path)?;
    raw.into_tets().map_err(|e| Error::format(path, e))
}

/// Reads the files of the parts of one mesh, joined as the pieces of a `.pvtu`: nodes of several
/// parts are the same by their `GlobalNodeIds`, otherwise by their position.
///
/// # Errors
/// As [`read`]; an error for no file.
pub fn read_parts(files: &[impl AsRef<Path>]) -> Result<TetMesh> {
    let Some(first) = files.first() else {
        return Err(Error::Input(
            "a mesh needs one file or more; got none".into(),
        ));
    };
    if files.len() == 1 {
        return read(first);
    }
    let named = |e| Error::format(first.as_ref(), e);
    let parts: Vec<raw_mesh::RawMesh> = files
        .iter()
        .map(|file| raw_mesh(file.as_ref()))
        .collect::<Result<_>>()?;
    let joined = join::join(parts).map_err(named)?;
    joined.into_tets().map_err(named)
}

/// Reads the cells of a file in any supported format.
fn raw_mesh(path: &Path) -> Result<raw_mesh::RawMesh> {
    let extension = volume::extension(path);
    if extension == "node" || extension == "ele" {
        return tetgen::read(path);
    }
    let bytes = abaqus_include::expand(path, content(path)?)?;
    if holds_pieces(&bytes) {
        return pvtu::read(path, &bytes);
    }
    format_of(&bytes, &extension)
        .and_then(|reader| reader(&bytes))
        .map_err(|e| Error::format(path, e))
}

/// Kind of the content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An image on a regular grid: [`read_volume`] reads it.
    Volume,
    /// Triangles or polygons: [`read_surface`] reads it.
    Surface,
    /// Cells: [`read`] reads them.
    Mesh,
}

/// Detects the kind of the file (or folder of DICOM slices) at `path` from its content, then its
/// extension. An unknown file counts as a mesh, whose reader reports what it expected.
///
/// # Errors
/// An error if the file cannot be read.
pub fn detect_kind(path: impl AsRef<Path>) -> Result<Kind> {
    let path = path.as_ref();
    if path.is_dir() {
        return Ok(Kind::Volume);
    }
    let bytes = content(path)?;
    let extension = volume::extension(path);
    let polydata = vtk_legacy::holds(&bytes, "POLYDATA") || is_vtk_xml(&bytes, "PolyData");
    Ok(if volume::is_volume(&bytes, &extension) {
        Kind::Volume
    } else if polydata || surface::reader_of(&bytes, &extension).is_some() {
        Kind::Surface
    } else {
        Kind::Mesh
    })
}

type Reader = fn(&[u8]) -> cursor::ParseResult<raw_mesh::RawMesh>;

/// Returns the start of a file in lower case.
fn start_of(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(4096)];
    String::from_utf8_lossy(start.trim_ascii_start()).to_ascii_lowercase()
}

/// Whether this is an index of the pieces of a mesh.
fn holds_pieces(bytes: &[u8]) -> bool {
    is_vtk_xml(bytes, pvtu::KIND)
}

/// Whether this is a VTK XML file of the type `kind`.
fn is_vtk_xml(bytes: &[u8], kind: &str) -> bool {
    let start = start_of(bytes);
    let kind = format!("\"{}\"", kind.to_ascii_lowercase());
    start.starts_with('<') && start.contains("<vtkfile") && start.contains(&kind)
}

fn format_of(bytes: &[u8], extension: &str) -> cursor::ParseResult<Reader> {
    let start = start_of(bytes);
    let begins = |magic: &[u8]| start.as_bytes().starts_with(&magic.to_ascii_lowercase());
    let first_word = start
        .lines()
        .map(str::trim)
        .find(|l| !l.is_empty() && !l.starts_with('#'));
    if begins(vtk_legacy::MAGIC) {
        Ok(vtk_legacy::read)
    } else if begins(b"<") && start.contains("<vtkfile") {
        if start.contains("\"collection\"") {
            return Err(
                "expected a mesh, found a series of meshes (.pvd); name one of its files".into(),
            );
        }
        match holds_pieces(bytes) {
            true => Ok(pvtu::reject_index),
            false => Ok(vtu::read),
        }
    } else if begins(gmsh::MAGIC) || begins(gmsh::MAGIC_1) || (begins(b"$") && extension == "msh") {
        Ok(gmsh::read)
    } else if first_word.is_some_and(|w| w.starts_with(medit::MAGIC)) {
        Ok(medit::read)
    } else if first_word.is_some_and(|w| w.starts_with(mfem::MAGIC)) {
        Ok(mfem::read)
    } else if let Some(other) = other_formats::by_content(bytes, extension) {
        Err(other)
    } else if ucd::is_ucd(bytes) {
        Ok(ucd::read)
    } else if let Some(other) = other_formats::by_extension(extension) {
        // Before Abaqus, whose keywords are those of LS-DYNA.
        Err(other)
    } else if abaqus::is_abaqus(bytes) {
        Ok(abaqus::read)
    } else {
        // Unknown content: the reader selected by the extension reports what it expected.
        match extension {
            "vtk" => Ok(vtk_legacy::read),
            "vtu" | "vtp" => Ok(vtu::read),
            "msh" => Ok(gmsh::read),
            "mesh" => Ok(medit::read),
            "inp" => Ok(abaqus::read),
            _ => Err(format!(
                "unknown format: neither the content nor the extension is recognised; supported: \
                {READABLE_FORMATS}"
            )),
        }
    }
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}
