//! Named values at the nodes or in the tets of a mesh.

use std::fmt;

/// Location of the values of a [`Field`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Location {
    /// One tuple per node; `point` in files and reports, after the file formats.
    #[serde(rename = "point")]
    Node,
    /// One tuple per tet.
    Cell,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Location::Node => "nodes",
            Location::Cell => "cells",
        })
    }
}

/// Number type of a field in its file, preserved when it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// Named values: `components` numbers for each node or tet, tuple by tuple.
///
/// Values are stored as f64, exact for every [`ScalarType`] except 64-bit integers beyond 2⁵³.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Its name in the file.
    pub name: String,
    /// Nodes or cells.
    pub location: Location,
    /// Number of components of a tuple: 1 for a scalar, 3 for a vector.
    pub components: usize,
    /// All tuples, `components` numbers each.
    pub values: Vec<f64>,
    /// Number type in which it is written.
    pub scalar_type: ScalarType,
}

impl Field {
    /// Creates a scalar field of type f64.
    pub fn scalar(name: impl Into<String>, location: Location, values: Vec<f64>) -> Field {
        Field {
            name: name.into(),
            location,
            components: 1,
            values,
            scalar_type: ScalarType::F64,
        }
    }

    /// Returns the smallest and largest finite value (of the norms of the tuples if there are
    /// several components); `None` if there is no finite value.
    pub fn range(&self) -> Option<(f64, f64)> {
        let magnitude = |tuple: &[f64]| match tuple {
            [x] => *x,
            _ => tuple.iter().map(|x| x * x).sum::<f64>().sqrt(),
        };
        self.values
            .chunks_exact(self.components.max(1))
            .map(magnitude)
            .filter(|x| x.is_finite())
            .fold(None, |range, x| match range {
                None => Some((x, x)),
                Some((low, high)) => Some((low.min(x), high.max(x))),
            })
    }
}
