//! Files in and out: one file a format. Nothing here knows of the GPU.
//!
//! Readers fill a raw mesh of cells of any kind with fields; `raw_mesh` turns that into tets,
//! and [`TetMesh::new`] makes them safe to work with. Every error says where in the file the
//! trouble is; no count in a file sizes anything before it is held against the file's length.

mod abaqus;
mod abaqus_elements;
mod abaqus_lines;
mod abaqus_sets;
mod abaqus_write;
mod atomic;
mod cell_kinds;
mod cursor;
mod format;
mod frames;
#[doc(hidden)]
pub mod fuzz;
mod gmsh;
mod gmsh_data;
mod gmsh_kinds;
mod gmsh_source;
mod gmsh_write;
mod groups;
mod id_map;
mod medit;
mod medit_write;
mod metadata;
mod parse;
mod pvd;
mod pvtu;
mod raw_mesh;
mod scalar;
mod surface;
mod tetgen;
mod tetgen_write;
mod volume;
mod vtk_legacy;
mod vtk_legacy_data;
mod vtk_legacy_names;
mod vtk_legacy_write;
mod vtk_regions;
mod vtu;
mod vtu_data;
mod vtu_tags;
mod vtu_write;

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use atomic::TempFile;
pub use atomic::atomic_write;
pub use format::{MeshFormat, write, write_as};
pub use frames::{FrameStream, TimedPositions};
pub use parse::{parse, parse_surface, parse_volume};
pub use pvd::{Frame, PvdSeries, read_pvd};
pub(crate) use pvtu::PRIVATE_PREFIX;
pub use pvtu::{is_pieces, piece_files, read_piece, write_pieces};
pub use surface::{read_surface, write_surface};
pub(crate) use volume::{Layout, VolumeFormat, VolumeStream};
pub use volume::{read_volume, write_volume};

use crate::files;
pub use crate::files::{OutFile, exists, read_text};
#[cfg(target_arch = "wasm32")]
pub use crate::files::{insert_file, take_file};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use std::path::Path;

/// What [`read`] can read, for messages.
const READABLE_FORMATS: &str = "VTK legacy (.vtk), VTK XML (.vtu, .pvtu), Gmsh (.msh), TetGen (.node with .ele), Medit (.mesh) and Abaqus (.inp)";

/// Reads a mesh of any format that is known: VTK legacy, VTU, Gmsh 1 to 4.1, TetGen, Medit, Abaqus;
/// of a mesh in pieces (`.pvtu`) all of them, as one.
/// The content decides, then the extension. What was changed on the way (cells cut or dropped,
/// repairs) is told in [`TetMesh::repairs`].
///
/// # Errors
/// A file that cannot be read, that is damaged, or that has no volume in it.
pub fn read(path: impl AsRef<Path>) -> Result<TetMesh> {
    let path = path.as_ref();
    let extension = extension(path);
    let raw = if extension == "node" || extension == "ele" {
        tetgen::read(path)?
    } else {
        let bytes = content(path)?;
        match holds_pieces(&bytes) {
            true => pvtu::read(path, &bytes)?,
            false => format_of(&bytes, &extension)
                .and_then(|reader| reader(&bytes))
                .map_err(|e| Error::format(path, e))?,
        }
    };
    raw.into_tets().map_err(|e| Error::format(path, e))
}

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An image on a regular grid: [`read_volume`] reads it.
    Volume,
    /// Triangles or polygons: [`read_surface`] reads it.
    Surface,
    /// Cells, as [`read`] reads them.
    Mesh,
}

/// What the file (or folder of DICOM slices) at `path` holds, by its content, then its
/// extension. A file of no known kind counts as a mesh, whose reader says what it expected.
///
/// # Errors
/// The file cannot be read.
pub fn detect_kind(path: impl AsRef<Path>) -> Result<Kind> {
    let path = path.as_ref();
    if path.is_dir() {
        return Ok(Kind::Volume);
    }
    let bytes = content(path)?;
    let extension = extension(path);
    let head = &bytes[..bytes.len().min(1024)];
    let polydata = bytes.starts_with(vtk_legacy::MAGIC)
        && String::from_utf8_lossy(head)
            .to_uppercase()
            .contains("DATASET POLYDATA");
    Ok(if volume::is_volume(&bytes, &volume::extension(path)) {
        Kind::Volume
    } else if polydata || surface::reader_of(&bytes, &extension).is_some() {
        Kind::Surface
    } else {
        Kind::Mesh
    })
}

type Reader = fn(&[u8]) -> cursor::ParseResult<raw_mesh::RawMesh>;

/// What a file begins with, in small letters.
fn start_of(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(4096)];
    String::from_utf8_lossy(start.trim_ascii_start()).to_ascii_lowercase()
}

/// Whether this is an index of the pieces of a mesh.
fn holds_pieces(bytes: &[u8]) -> bool {
    let start = start_of(bytes);
    let kind = format!("\"{}\"", pvtu::KIND.to_ascii_lowercase());
    start.starts_with('<') && start.contains("<vtkfile") && start.contains(&kind)
}

fn format_of(bytes: &[u8], extension: &str) -> cursor::ParseResult<Reader> {
    let start = start_of(bytes);
    let begins = |magic: &[u8]| start.as_bytes().starts_with(&magic.to_ascii_lowercase());
    let first_word = start
        .lines()
        .map(str::trim)
        .find(|l| !l.is_empty() && !l.starts_with('#'));
    if bytes.starts_with(&[0x1f, 0x8b]) {
        Err("the file is compressed by gzip; unpack it first (gunzip)".into())
    } else if begins(vtk_legacy::MAGIC) {
        Ok(vtk_legacy::read)
    } else if begins(b"<") && start.contains("<vtkfile") {
        if start.contains("\"collection\"") {
            return Err(
                "this is a series of meshes (.pvd), not a mesh; name one of its files".into(),
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
    } else if abaqus::is_abaqus(bytes) {
        Ok(abaqus::read)
    } else {
        // Nothing known at the start: the reader its name asks for says what it expected.
        match extension {
            "vtk" => Ok(vtk_legacy::read),
            "vtu" => Ok(vtu::read),
            "msh" => Ok(gmsh::read),
            "mesh" => Ok(medit::read),
            "inp" => Ok(abaqus::read),
            _ => Err(format!(
                "neither the content nor the extension is of a known format; Palpate reads {READABLE_FORMATS}"
            )),
        }
    }
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

/// What Windows programs put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The bytes of a file that is one, and is not empty; without a byte order mark.
fn content(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = files::read_regular(path)?;
    let length = content_of(path, &bytes)?.len();
    bytes.drain(..bytes.len() - length);
    Ok(bytes)
}

/// `bytes`, the content of `path`, without a byte order mark; they are not empty.
fn content_of<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a [u8]> {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    match bytes.trim_ascii().is_empty() {
        true => Err(Error::format(path, "the file is empty")),
        false => Ok(bytes),
    }
}
