//! Parsers of files in memory, for programs without a file system such as browsers.

use super::{content_of, format_of, surface, volume};
use crate::mesh::{TetMesh, TriMesh};
use crate::volume::Volume;
use crate::{Error, Result};
use std::path::Path;

/// Parses a mesh from the content of a file `name`, as [`read`](super::read) reads the file: the
/// format is detected from the content, then from the extension.
///
/// # Errors
/// As [`read`](super::read); an error for TetGen files, which come in pairs.
pub fn parse(name: &str, bytes: &[u8]) -> Result<TetMesh> {
    let path = Path::new(name);
    let extension = volume::extension(path);
    if extension == "node" || extension == "ele" {
        return Err(Error::format(
            path,
            "TetGen meshes consist of two files, .node and .ele; give a single file, for example \
            .vtu or .msh",
        ));
    }
    let bytes = &*content_of(path, bytes)?;
    format_of(bytes, &extension)
        .and_then(|reader| reader(bytes))
        .and_then(super::raw_mesh::RawMesh::into_tets)
        .map_err(|e| Error::format(path, e))
}

/// Parses a surface from the content of a file `name`, as [`read_surface`](super::read_surface)
/// reads the file.
///
/// # Errors
/// As [`read_surface`](super::read_surface).
pub fn parse_surface(name: &str, bytes: &[u8]) -> Result<TriMesh> {
    let path = Path::new(name);
    let bytes = &*content_of(path, bytes)?;
    surface::surface_of(bytes, &volume::extension(path)).map_err(|e| Error::format(path, e))
}

/// Parses a volume from the content of a file `name`, as [`read_volume`](super::read_volume) reads
/// the file.
///
/// # Errors
/// As [`read_volume`](super::read_volume); an error for headers with detached voxels.
pub fn parse_volume(name: &str, bytes: &[u8]) -> Result<Volume> {
    let path = Path::new(name);
    let bytes = &*content_of(path, bytes)?;
    let fetch = |data: &str| {
        Err(format!(
            "voxels are in another file, {}; give a single file with header and voxels (.nrrd, \
            .mha or .nii)",
            data.trim()
        ))
    };
    volume::volume_of(bytes, &volume::extension(path), &fetch, None)
        .map_err(|e| Error::format(path, e))
}
