//! Entry points of the readers for fuzzing: bytes in, a mesh, surface, volume or error out.

use super::raw_mesh::RawMesh;
use crate::mesh::{TetMesh, TriMesh};
use crate::volume::Volume;

type ParseOutcome<T> = Result<T, String>;

/// The readers.
#[derive(Clone, Copy, Debug)]
pub struct Readers;

impl Readers {
    /// Parses a mesh file with that extension, up to the tets.
    pub fn mesh(extension: &str, bytes: &[u8]) -> ParseOutcome<TetMesh> {
        let bytes = super::content::decoded(bytes)?;
        let reader = super::format_of(&bytes, extension)?;
        reader(&bytes)?.into_tets().map_err(|e| e.to_string())
    }

    /// Parses a pair of TetGen files.
    pub fn tetgen(node: &[u8], ele: &[u8]) -> ParseOutcome<TetMesh> {
        let mut mesh = RawMesh::default();
        let tags = super::tetgen::read_nodes(node, &mut mesh)?;
        super::tetgen::read_elements(ele, &tags, &mut mesh)?;
        mesh.into_tets().map_err(|e| e.to_string())
    }

    /// Parses a series of frames; returns their number.
    pub fn pvd(bytes: &[u8]) -> ParseOutcome<usize> {
        super::pvd::frames_of(super::pvd::parse(bytes)?).map(|frames| frames.len())
    }

    /// Parses an index of pieces; returns their number.
    pub fn pvtu(bytes: &[u8]) -> ParseOutcome<usize> {
        super::pvtu::index(bytes).map(|files| files.len())
    }

    /// Parses a surface file with that extension.
    pub fn surface(extension: &str, bytes: &[u8]) -> ParseOutcome<TriMesh> {
        super::surface::surface_of(&super::content::decoded(bytes)?, extension)
    }

    /// Parses a volume file whose detached data are all `data`.
    pub fn volume(bytes: &[u8], data: &[u8]) -> ParseOutcome<Volume> {
        super::volume::volume_of(bytes, "", &|_| Ok(data.to_vec()), None)
    }

    /// As [`Readers::volume`], for volume `number` of the file `NAME.extension`.
    pub fn volume_number(extension: &str, bytes: &[u8], number: usize) -> ParseOutcome<Volume> {
        let no_other = |_: &str| Err("no other file".to_owned());
        super::volume::volume_of(bytes, extension, &no_other, Some(number))
    }

    /// Parses a DICOM file; returns whether it contains an image.
    #[cfg(feature = "dicom")]
    pub fn dicom(bytes: &[u8]) -> ParseOutcome<bool> {
        super::volume::dicom::parse(bytes)
    }
}
