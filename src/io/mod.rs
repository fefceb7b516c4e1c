//! Readers and writers, one file per format. This module is independent of the GPU.
//!
//! Readers fill a raw mesh of cells of any type with fields; `cells` converts it to tets, and
//! [`TetMesh::new`] validates and repairs them. Every error states the position in the file; counts
//! in a file are checked against its length before they size an allocation.

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
pub use volume::{read_volume, read_volume_number, write_volume};

use crate::files;
pub use crate::files::{OutFile, exists, read_text};
#[cfg(target_arch = "wasm32")]
pub use crate::files::{insert_file, take_file};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use std::path::Path;

/// Formats supported by [`read`], for messages.
const READABLE_FORMATS: &str = "VTK legacy (.vtk), VTK XML (.vtu, .pvtu), Gmsh (.msh), TetGen (.node with .ele), Medit (.mesh) and Abaqus (.inp)";

/// Reads a mesh in any supported format: VTK legacy, VTU, Gmsh 1 to 4.1, TetGen, Medit, Abaqus; the
/// pieces of a partitioned mesh (`.pvtu`) are merged. The format is detected from the content, then
/// from the extension. Changes (cells subdivided or dropped, repairs) are reported in
/// [`TetMesh::repairs`].
///
/// # Errors
/// An error if the file cannot be read, is damaged, or contains no volume.
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

/// Returns the start of a file in lower case.
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
        Err("file is compressed with gzip; decompress it first (gunzip)".into())
    } else if begins(vtk_legacy::MAGIC) {
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
    } else if abaqus::is_abaqus(bytes) {
        Ok(abaqus::read)
    } else {
        // Unknown content: the reader selected by the extension reports what it expected.
        match extension {
            "vtk" => Ok(vtk_legacy::read),
            "vtu" => Ok(vtu::read),
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

/// The byte order mark that Windows programs put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Returns the content of a regular, non-empty file without a byte order mark.
fn content(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = files::read_regular(path)?;
    let length = content_of(path, &bytes)?.len();
    bytes.drain(..bytes.len() - length);
    Ok(bytes)
}

/// Returns `bytes`, the content of `path`, without a byte order mark; it must not be empty.
fn content_of<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a [u8]> {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    match bytes.trim_ascii().is_empty() {
        true => Err(Error::format(path, "file is empty")),
        false => Ok(bytes),
    }
}
