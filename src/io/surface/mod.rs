//! Readers and writers of triangle surfaces, one file per format.
//!
//! The crates for these formats (`stl_io`, `ply-rs-bw`, `tobj`) size allocations by unchecked
//! headers, or drop fields, so these are separate readers.

mod obj;
mod ply;
mod polygon;
mod repair;
mod stl;
mod triangles;
mod write;

pub use write::write_surface;

use super::cursor::ParseResult;
use super::raw_mesh::RawMesh;
use crate::mesh::{AnatomicalFrame, TriMesh};
use crate::{Error, Result};
use std::path::Path;

pub(super) type Reader = fn(&[u8]) -> ParseResult<RawMesh>;

/// Returns the reader for STL, PLY or OBJ.
pub(super) fn reader_of(bytes: &[u8], extension: &str) -> Option<Reader> {
    if bytes.starts_with(ply::MAGIC) {
        Some(ply::read)
    } else if extension == "obj" {
        Some(obj::read)
    } else if extension == "stl" {
        Some(stl::read)
    } else {
        None
    }
}

/// Reads a triangle surface: STL, PLY, OBJ, VTK POLYDATA, or the surface cells of any mesh format
/// that [`read`](super::read) supports. Polygons are triangulated, coincident vertices merged,
/// degenerate triangles dropped; [`TriMesh::notes`] reports the changes.
///
/// # Errors
/// An error if the file cannot be read, is damaged, or contains no surface.
pub fn read_surface(path: impl AsRef<Path>) -> Result<TriMesh> {
    let path = path.as_ref();
    let extension = super::volume::extension(path);
    let bytes = super::abaqus_include::expand(path, super::content(path)?)?;
    surface_of(&bytes, &extension).map_err(|e| Error::format(path, e))
}

/// Parses the surface in the content of a file with that extension.
pub(super) fn surface_of(bytes: &[u8], extension: &str) -> ParseResult<TriMesh> {
    let reader = match reader_of(bytes, extension) {
        Some(reader) => reader,
        None => super::format_of(bytes, extension)?,
    };
    let mut raw = reader(bytes)?;
    raw.frame = raw.frame.or_else(|| AnatomicalFrame::stated_in(bytes));
    triangles::into_surface(raw)
}
