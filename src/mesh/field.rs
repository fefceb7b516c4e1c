//! Named values at the nodes or in the tets of a mesh.

use std::fmt;

/// Where the values of a [`Field`] live.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Location {
    /// One tuple a node; `point` in files and reports, as the file formats call it.
    #[serde(rename = "point")]
    Node,
    /// One tuple a tet.
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

/// The number type a field had in its file, so that it is written back as it came.
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

/// Values by name: `components` numbers for each node or tet, one tuple after the other.
///
/// Values are held in f64, exact for every [`ScalarType`] but 64-bit integers beyond 2⁵³.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The name it has in the file.
    pub name: String,
    /// Nodes or cells.
    pub location: Location,
    /// Numbers in a tuple: 1 for a scalar, 3 for a vector.
    pub components: usize,
    /// All tuples, `components` numbers each.
    pub values: Vec<f64>,
    /// The number type to write it back with.
    pub scalar_type: ScalarType,
}

impl Field {
    /// A field of one f64 a node.
    pub fn scalar(name: impl Into<String>, location: Location, values: Vec<f64>) -> Field {
        Field {
            name: name.into(),
            location,
            components: 1,
            values,
            scalar_type: ScalarType::F64,
        }
    }

    /// Smallest and largest finite value (of the tuples' lengths when there are several
    /// components); `None` when nothing is finite.
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
