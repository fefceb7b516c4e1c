//! Conversions between Rust vectors and numpy arrays; each copies the data once.

use crate::errors::input_error;
use glam::DVec3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

/// Returns points as an (n, 3) array.
pub fn from_points<'py>(py: Python<'py>, points: &[DVec3]) -> Bound<'py, PyArray2<f64>> {
    let flat: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    rows(py, flat, 3)
}

/// Returns a flat vector as a two-dimensional array with rows of `width`, which must divide its
/// length.
pub fn rows<T: numpy::Element>(
    py: Python<'_>,
    flat: Vec<T>,
    width: usize,
) -> Bound<'_, PyArray2<T>> {
    let shape = (flat.len() / width.max(1), width);
    let array = Array2::from_shape_vec(shape, flat)
        .unwrap_or_else(|_| Array2::from_shape_fn((0, width), |_| unreachable!()));
    array.into_pyarray(py)
}

/// Reads the rows of an (n, 3) array; an error names the array as `what` if its shape differs.
pub fn to_points(
    py: Python<'_>,
    array: &PyReadonlyArray2<'_, f64>,
    what: &str,
) -> PyResult<Vec<DVec3>> {
    let array = array.as_array();
    match array.ncols() {
        3 => Ok(array
            .rows()
            .into_iter()
            .map(|p| DVec3::new(p[0], p[1], p[2]))
            .collect()),
        columns => Err(input_error(
            py,
            format!("{what} must have shape (n, 3), got (n, {columns})"),
        )),
    }
}
