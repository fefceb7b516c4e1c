//! Meshes stored in pieces, each rendered separately.

use crate::devices::device;
use crate::errors::Raise;
use crate::mesh::Mesh;
use crate::scenes;
use numpy::{IntoPyArray, PyArray1};
use palpate::scene::Piece;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::time::Instant;

/// Ray segments of an image inside some of the pieces of a body.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Intervals(palpate::render::RaySegments);

#[pymethods]
impl Intervals {
    /// Renders one piece for the image that these entries describe. Returns the segments, the
    /// number of its own tets, the number including its neighbours' tets, and the seconds for
    /// reading and rendering.
    #[staticmethod]
    fn of_piece(
        py: Python<'_>,
        index: PathBuf,
        number: usize,
        entries: &str,
        folder: PathBuf,
        adapter: Option<String>,
    ) -> PyResult<(Intervals, [usize; 2], [f64; 2])> {
        let gpu = device(py, adapter)?;
        let rendered = py.detach(|| {
            let scene = scenes::scene(entries, &folder)?;
            let start = Instant::now();
            let piece = Piece::read(&index, number)?;
            let read = start.elapsed();
            let segments = piece.intervals(&gpu, &scene)?;
            let times = [read, start.elapsed() - read].map(|t| t.as_secs_f64());
            let mesh = piece.mesh();
            Ok((
                Intervals(segments),
                [mesh.owned_tets, mesh.tets.len()],
                times,
            ))
        });
        rendered.or_raise(py)
    }

    /// Returns these segments merged with those of other pieces.
    #[pyo3(name = "joined")]
    fn merged(&self, py: Python<'_>, other: &Intervals) -> PyResult<Intervals> {
        let joined = py.detach(|| self.0.merged(&other.0)).or_raise(py)?;
        Ok(Intervals(joined))
    }

    /// Returns the number of segments.
    fn count(&self) -> usize {
        self.0.items().len()
    }

    /// Returns the image of all pieces as 8-bit RGBA, as in a PNG.
    fn rgba<'py>(
        &self,
        py: Python<'py>,
        entries: &str,
        folder: PathBuf,
    ) -> PyResult<(Bound<'py, PyArray1<u8>>, [u32; 2])> {
        let drawn = py.detach(|| scenes::scene(entries, &folder)?.composite_rgba(&self.0));
        let (bytes, size) = drawn.or_raise(py)?;
        Ok((bytes.into_pyarray(py), size))
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &py.detach(|| self.0.to_bytes()))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Intervals> {
        let read = py.detach(|| palpate::render::RaySegments::from_bytes(bytes));
        Ok(Intervals(read.or_raise(py)?))
    }
}

/// Returns the number of pieces that an index lists.
#[pyfunction]
pub fn count_pieces(py: Python<'_>, index: PathBuf) -> PyResult<usize> {
    let files = py
        .detach(|| palpate::io::piece_files(&index))
        .or_raise(py)?;
    Ok(files.len())
}

/// Writes a mesh as `count` pieces.
#[pyfunction]
pub fn write_pieces(py: Python<'_>, mesh: &Mesh, index: PathBuf, count: usize) -> PyResult<()> {
    py.detach(|| palpate::scene::write_pieces(&index, &mesh.0, count))
        .or_raise(py)
}
