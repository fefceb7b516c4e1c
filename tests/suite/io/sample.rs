//! A small mesh that every encoder of [`crate::io::encode`] writes, and the expected result of
//! reading it.

use glam::DVec3;
use palpate::mesh::{Field, Location, ScalarType, TetMesh};
use std::path::PathBuf;

/// A mesh as stored in a file.
#[derive(Clone, Default)]
pub struct Sample {
    pub nodes: Vec<DVec3>,
    /// VTK type and the nodes of each cell.
    pub cells: Vec<(u8, Vec<usize>)>,
    pub fields: Vec<Field>,
}

impl Sample {
    /// Returns two tets and a triangle in between, with fields of several types. The last value of
    /// each array has one digit, so that a truncated ASCII file is detected.
    pub fn new() -> Sample {
        let nodes = [
            [0.1, 0.0, -0.0],
            [1.0 / 3.0, 1e-3, 0.0],
            [0.0, 2.0, 0.0],
            [0.0, 0.0, 1e3],
            [7.25, 7.0, 8.0],
        ];
        let field = |name: &str, location, components, scalar_type, values: &[f64]| Field {
            name: name.into(),
            location,
            components,
            values: values.to_vec(),
            scalar_type,
        };
        Sample {
            nodes: nodes.map(DVec3::from_array).to_vec(),
            cells: vec![
                (10, vec![0, 1, 2, 3]),
                (5, vec![1, 2, 3]),
                (10, vec![1, 4, 2, 3]),
            ],
            fields: vec![
                field(
                    "warm & cosy",
                    Location::Node,
                    1,
                    ScalarType::F32,
                    &[0.5, 1.5, f64::from(0.1f32), -3.0, 4.0],
                ),
                field(
                    "flow",
                    Location::Node,
                    3,
                    ScalarType::F64,
                    &(0..15).map(|i| f64::from(i) / 3.0).collect::<Vec<_>>()[..14]
                        .iter()
                        .copied()
                        .chain([9.0])
                        .collect::<Vec<_>>(),
                ),
                field(
                    "label",
                    Location::Cell,
                    1,
                    ScalarType::I32,
                    &[70_000.0, -1.0, 3.0],
                ),
                field(
                    "kind",
                    Location::Cell,
                    2,
                    ScalarType::U8,
                    &[255.0, 1.0, 2.0, 0.0, 5.0, 6.0],
                ),
            ],
        }
    }

    /// Keeps only the fields accepted by `keep`.
    pub fn with_fields(mut self, keep: impl Fn(&Field) -> bool) -> Sample {
        self.fields.retain(keep);
        self
    }

    /// Returns the expected result: the tets of the sample with their part of the fields.
    pub fn tets(&self) -> TetMesh {
        let tets: Vec<usize> = (0..self.cells.len())
            .filter(|c| self.cells[*c].0 == 10)
            .collect();
        let fields = self.fields.iter().cloned().map(|mut f| {
            if f.location == Location::Cell {
                f.values = tets
                    .iter()
                    .flat_map(|c| f.values[c * f.components..][..f.components].to_vec())
                    .collect();
            }
            f
        });
        let corners = |c: &usize| {
            <[u32; 4]>::try_from(
                self.cells[*c]
                    .1
                    .iter()
                    .map(|v| *v as u32)
                    .collect::<Vec<_>>(),
            )
            .unwrap()
        };
        TetMesh::new(
            self.nodes.clone(),
            tets.iter().map(corners).collect(),
            fields.collect(),
            Vec::new(),
        )
        .unwrap()
    }
}

/// Returns the bits of everything in a mesh, fields ordered by name: equal means identical.
pub fn bits(mesh: &TetMesh) -> impl PartialEq + std::fmt::Debug + use<> {
    let nodes: Vec<[u64; 3]> = mesh
        .nodes
        .iter()
        .map(|p| p.to_array().map(f64::to_bits))
        .collect();
    let mut fields: Vec<_> = mesh
        .fields
        .iter()
        .map(|f| {
            let values: Vec<u64> = f.values.iter().map(|v| v.to_bits()).collect();
            (
                f.name.clone(),
                f.location.to_string(),
                f.components,
                format!("{:?}", f.scalar_type),
                values,
            )
        })
        .collect();
    fields.sort();
    (nodes, mesh.tets.clone(), fields)
}

/// A file (or a pair of TetGen files) to be read.
pub struct Fixture {
    pub name: String,
    pub bytes: Vec<u8>,
    /// `.ele` beside a `.node`.
    pub second: Option<Vec<u8>>,
    /// Lengths at which a truncated file cannot be told from a complete one.
    pub may_end: Vec<usize>,
    pub expected: TetMesh,
}

impl Fixture {
    pub fn new(name: impl Into<String>, bytes: Vec<u8>, expected: TetMesh) -> Fixture {
        Fixture {
            name: name.into(),
            bytes,
            second: None,
            may_end: Vec::new(),
            expected,
        }
    }
}

/// A folder for fixtures, reused for all files.
pub struct Bench(tempfile::TempDir);

impl Bench {
    pub fn new() -> Bench {
        Bench(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn read(&self, name: &str, bytes: &[u8]) -> palpate::Result<TetMesh> {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        palpate::io::read(&path)
    }

    /// Reads a fixture with other bytes instead of its own.
    pub fn read_as(
        &self,
        fixture: &Fixture,
        bytes: &[u8],
        second: Option<&[u8]>,
    ) -> palpate::Result<TetMesh> {
        if let Some(second) = second {
            std::fs::write(self.path(&fixture.name).with_extension("ele"), second).unwrap();
        }
        self.read(&fixture.name, bytes)
    }
}
