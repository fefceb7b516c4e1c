//! Volumes: images on regular grids.

use crate::arrays::to_points;
use crate::errors::{Raise, input_error};
use glam::{DAffine3, DMat3};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use palpate::volume::Raw;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// An immutable volume.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Volume(pub Arc<palpate::volume::Volume>);

/// Converts numpy arrays of every supported number type.
macro_rules! kinds {
    ($($kind:ident $type:ty),*) => {
        fn to_raw(values: &Bound<'_, PyAny>) -> Option<Raw> {
            $(if let Ok(array) = values.cast::<PyArray1<$type>>() {
                return array.to_vec().ok().map(Raw::$kind);
            })*
            None
        }

        fn from_raw<'py>(py: Python<'py>, raw: &Raw) -> Bound<'py, PyAny> {
            match raw {
                $(Raw::$kind(values) => PyArray1::from_slice(py, values).into_any()),*
            }
        }
    };
}
kinds!(I8 i8, U8 u8, I16 i16, U16 u16, I32 i32, U32 u32, I64 i64, U64 u64, F32 f32, F64 f64);

#[pymethods]
impl Volume {
    /// Creates a volume from values with the first axis running fastest. `to_world` holds the upper
    /// three rows of the affine, transposed: the voxel vector along each axis, and the position of
    /// the first voxel.
    #[new]
    fn new(
        py: Python<'_>,
        values: &Bound<'_, PyAny>,
        size: [usize; 3],
        to_world: PyReadonlyArray2<'_, f64>,
        names: BTreeMap<i64, String>,
    ) -> PyResult<Volume> {
        let raw = to_raw(values).ok_or_else(|| {
            input_error(
                py,
                "voxels must be integers of 8 to 64 bits, float32 or float64",
            )
        })?;
        let world = to_points(py, &to_world, "affine")?;
        let [i, j, k, origin] = world[..] else {
            return Err(input_error(py, "affine must have shape (4, 4)"));
        };
        let to_world = DAffine3::from_mat3_translation(DMat3::from_cols(i, j, k), origin);
        let sound = to_world.is_finite() && to_world.matrix3.determinant() != 0.0;
        if !sound || size.contains(&0) {
            return Err(input_error(
                py,
                "a volume requires voxels along each of three axes and an affine that can be inverted",
            ));
        }
        if raw.len() != size.iter().product::<usize>() {
            return Err(input_error(
                py,
                format!(
                    "the number of voxels, {}, does not match the size {size:?}",
                    raw.len()
                ),
            ));
        }
        let mut volume = palpate::volume::Volume {
            size,
            raw,
            to_world,
            label_names: names,
            ..palpate::volume::Volume::default()
        };
        volume.round_near_labels();
        Ok(Volume(Arc::new(volume)))
    }

    #[staticmethod]
    #[pyo3(signature = (path, number=None))]
    fn read(py: Python<'_>, path: PathBuf, number: Option<usize>) -> PyResult<Volume> {
        let read = || palpate::io::read_volume_number(&path, number);
        let volume = py.detach(read).or_raise(py)?;
        Ok(Volume(Arc::new(volume)))
    }

    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| palpate::io::write_volume(&path, &self.0))
            .or_raise(py)
    }

    /// Returns the stored numbers, the first axis running fastest.
    fn raw<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        from_raw(py, &self.0.raw)
    }

    fn size(&self) -> [usize; 3] {
        self.0.size
    }

    fn slope_and_intercept(&self) -> (f64, f64) {
        (self.0.slope, self.0.intercept)
    }

    fn affine(&self) -> [[f64; 4]; 4] {
        let m = self.0.to_world.matrix3.transpose().to_cols_array_2d();
        let t = self.0.to_world.translation;
        let row = |n: usize, t: f64| [m[n][0], m[n][1], m[n][2], t];
        [row(0, t.x), row(1, t.y), row(2, t.z), [0.0, 0.0, 0.0, 1.0]]
    }

    fn names(&self) -> BTreeMap<i64, String> {
        self.0.label_names.clone()
    }

    fn colours(&self) -> BTreeMap<i64, [f64; 3]> {
        self.0.label_colours.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }
}
