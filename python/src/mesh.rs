//! Tetrahedral meshes.

use crate::arrays::{from_points, rows, to_points};
use crate::errors::{Raise, input_error};
use crate::scenes;
use crate::work::LongTask;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use palpate::generate::GENERATORS;
use palpate::mesh::{AnatomicalFrame, ElementOrder, Field, Location, ScalarType, TetMesh};
use palpate::scene::FieldRanges;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// An immutable mesh.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Mesh(pub Arc<TetMesh>);

impl From<TetMesh> for Mesh {
    fn from(mesh: TetMesh) -> Mesh {
        Mesh(Arc::new(mesh))
    }
}

/// A field as Python passes it: name, whether it is a cell field, values in rows, and number type.
type FieldGiven<'py> = (String, bool, PyReadonlyArray2<'py, f64>, String);

/// The nodes of the cells of a new mesh.
enum Cells {
    Tets(Vec<[u32; 4]>),
    TenNodeTets(Vec<[u32; 10]>),
}

/// Converts rows of 4 or, in VTK's order, 10 nodes.
fn indices(py: Python<'_>, tets: &PyReadonlyArray2<'_, i64>) -> PyResult<Cells> {
    // The middles of the edges 01, 02, 03, 12, 13, 23.
    const FROM_VTK: [usize; 10] = [0, 1, 2, 3, 4, 6, 7, 5, 8, 9];
    match tets.as_array().ncols() {
        4 => Ok(Cells::Tets(index_rows(py, tets)?)),
        10 => {
            let rows = index_rows::<10>(py, tets)?.into_iter();
            let sorted = rows.map(|row| FROM_VTK.map(|k| row[k]));
            Ok(Cells::TenNodeTets(sorted.collect()))
        }
        columns => Err(input_error(
            py,
            format!("tets must have shape (n, 4) or (n, 10), got (n, {columns})"),
        )),
    }
}

fn index_rows<const N: usize>(
    py: Python<'_>,
    tets: &PyReadonlyArray2<'_, i64>,
) -> PyResult<Vec<[u32; N]>> {
    let mut indices = Vec::new();
    for (t, row) in tets.as_array().rows().into_iter().enumerate() {
        let mut tet = [0; N];
        for (corner, v) in tet.iter_mut().zip(row) {
            *corner = u32::try_from(*v).map_err(|_| {
                input_error(
                    py,
                    format!("tet {t} refers to node {v}; node indices must be ≥ 0"),
                )
            })?;
        }
        indices.push(tet);
    }
    Ok(indices)
}

#[pymethods]
impl Mesh {
    #[new]
    fn new(
        py: Python<'_>,
        nodes: PyReadonlyArray2<'_, f64>,
        tets: PyReadonlyArray2<'_, i64>,
        fields: Vec<FieldGiven<'_>>,
        region_names: BTreeMap<i64, String>,
        length_unit: Option<f64>,
        frame: Option<&str>,
    ) -> PyResult<Mesh> {
        let frame: Option<AnatomicalFrame> = frame.map(str::parse).transpose().or_raise(py)?;
        let nodes = to_points(py, &nodes, "nodes")?;
        let indices = indices(py, &tets)?;
        let fields = fields.into_iter().map(|(name, in_tets, values, kind)| {
            let values = values.as_array();
            Field {
                name,
                location: match in_tets {
                    true => Location::Cell,
                    false => Location::Node,
                },
                components: values.ncols(),
                values: values.iter().copied().collect(),
                scalar_type: scalar_type(&kind),
            }
        });
        let fields = fields.collect();
        let mesh = py.detach(|| match indices {
            Cells::Tets(tets) => TetMesh::new(nodes, tets, fields, Vec::new()),
            Cells::TenNodeTets(tets) => {
                TetMesh::from_ten_node_tets(nodes, &tets, fields, Vec::new())
            }
        });
        let mut mesh = mesh.or_raise(py)?;
        mesh.region_names = region_names;
        mesh.length_unit = length_unit;
        if let Some(frame) = frame {
            mesh.convert_to_ras(frame);
        }
        Ok(mesh.into())
    }

    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Mesh> {
        let mesh = py.detach(|| palpate::io::read(&path)).or_raise(py)?;
        Ok(mesh.into())
    }

    /// Reads the parts of one mesh.
    #[staticmethod]
    fn read_parts(py: Python<'_>, paths: Vec<PathBuf>) -> PyResult<Mesh> {
        let mesh = py.detach(|| palpate::io::read_parts(&paths)).or_raise(py)?;
        Ok(mesh.into())
    }

    /// Returns the range of the finite values of each field, by name.
    fn field_ranges(&self) -> BTreeMap<String, (f64, f64)> {
        let mut ranges = FieldRanges::default();
        ranges.add(&self.0.fields);
        let all = ranges.iter().map(|(name, range)| (name.to_owned(), range));
        all.collect()
    }

    /// Returns the data that the format cannot store.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<Vec<String>> {
        py.detach(|| palpate::io::write(&path, &self.0))
            .or_raise(py)
    }

    fn nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        from_points(py, &self.0.nodes)
    }

    fn tets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        rows(py, self.0.tets.iter().flatten().copied().collect(), 4)
    }

    /// Returns the order of the elements.
    fn order(&self) -> u32 {
        self.0.order.number()
    }

    fn counts(&self) -> (usize, usize) {
        (self.0.nodes.len(), self.0.tets.len())
    }

    /// Returns the name, whether it is a cell field, the components and the number type of each
    /// field.
    fn fields(&self) -> Vec<(String, bool, usize, &'static str)> {
        let describe = |f: &Field| {
            let in_tets = f.location == Location::Cell;
            (
                f.name.clone(),
                in_tets,
                f.components,
                type_name(f.scalar_type),
            )
        };
        self.0.fields.iter().map(describe).collect()
    }

    fn field<'py>(&self, py: Python<'py>, number: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let field = self.0.fields.get(number);
        let field = field.ok_or_else(|| input_error(py, format!("unknown field {number}")))?;
        Ok(PyArray1::from_slice(py, &field.values))
    }

    fn region_names(&self) -> BTreeMap<i64, String> {
        self.0.region_names.clone()
    }

    fn length_unit(&self) -> Option<f64> {
        self.0.length_unit
    }

    fn frame(&self) -> Option<String> {
        self.0.frame.map(|frame| frame.to_string())
    }

    fn notes(&self) -> Vec<String> {
        self.0.repairs.warnings.clone()
    }

    fn volume(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.0.volume())
    }

    fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let (low, high) = self.0.bounds();
        (low.to_array(), high.to_array())
    }

    /// Returns a copy of the mesh with new node positions.
    fn moved(&self, py: Python<'_>, nodes: PyReadonlyArray2<'_, f64>) -> PyResult<Mesh> {
        let nodes = to_points(py, &nodes, "nodes")?;
        if nodes.len() != self.0.nodes.len() {
            return Err(input_error(
                py,
                format!(
                    "got {} positions, but the mesh has {} nodes",
                    nodes.len(),
                    self.0.nodes.len()
                ),
            ));
        }
        let mut mesh = TetMesh::clone(&self.0);
        mesh.nodes = nodes;
        Ok(mesh.into())
    }

    /// Returns the order of the elements and the mesh as a file in memory, for pickling. The file has
    /// the pieces of ten-node tets, which keeps the values of fields in each.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<(u32, Bound<'py, PyBytes>)> {
        let bytes = py.detach(|| -> palpate::Result<Vec<u8>> {
            let folder = tempfile::tempdir().map_err(palpate::Error::io("temporary folder"))?;
            let file = folder.path().join("mesh.vtu");
            let pieces = TetMesh {
                order: ElementOrder::Linear,
                ..TetMesh::clone(&self.0)
            };
            palpate::io::write(&file, &pieces)?;
            std::fs::read(&file).map_err(palpate::Error::io(&file))
        });
        Ok((self.order(), PyBytes::new(py, &bytes.or_raise(py)?)))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, order: u32, bytes: &[u8]) -> PyResult<Mesh> {
        let mut mesh = palpate::io::parse("mesh.vtu", bytes).or_raise(py)?;
        mesh.order = ElementOrder::from_number(order.into()).or_raise(py)?;
        Ok(mesh.into())
    }
}

/// Loads the mesh that the entries of `[mesh]` specify: a file, a generator, or a volume or surface
/// to mesh.
#[pyfunction]
pub fn load_mesh(
    py: Python<'_>,
    entries: &str,
    folder: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<Mesh> {
    let scene = scenes::scene(entries, &folder).or_raise(py)?;
    let mesh = LongTask::new(progress)
        .run(py, |on_progress| scene.mesh.load_with_progress(on_progress))?;
    Ok(mesh.into())
}

/// Returns the names of the mesh generators.
#[pyfunction]
pub fn generators() -> Vec<&'static str> {
    GENERATORS.iter().map(|(name, _)| *name).collect()
}

/// Returns the number type for a numpy type name.
fn scalar_type(name: &str) -> ScalarType {
    match name {
        "int8" => ScalarType::I8,
        "uint8" => ScalarType::U8,
        "int16" => ScalarType::I16,
        "uint16" => ScalarType::U16,
        "int32" => ScalarType::I32,
        "uint32" => ScalarType::U32,
        "int64" => ScalarType::I64,
        "uint64" => ScalarType::U64,
        "float32" => ScalarType::F32,
        _ => ScalarType::F64,
    }
}

/// Returns the numpy name of a number type.
fn type_name(kind: ScalarType) -> &'static str {
    match kind {
        ScalarType::I8 => "int8",
        ScalarType::U8 => "uint8",
        ScalarType::I16 => "int16",
        ScalarType::U16 => "uint16",
        ScalarType::I32 => "int32",
        ScalarType::U32 => "uint32",
        ScalarType::I64 => "int64",
        ScalarType::U64 => "uint64",
        ScalarType::F32 => "float32",
        ScalarType::F64 => "float64",
    }
}
