//! Volumes: images of the inside of a body on a regular grid, placed in the world.
//!
//! The world frame is RAS in millimetres: x increases to the patient’s **R**ight, y to
//! **A**nterior, z to **S**uperior. Readers convert all volumes to it.

mod cube_cases;
mod describe;
mod grid;
mod isosurface;
mod near_labels;
mod sample;

pub use describe::{LabelDescription, VolumeDescription};
pub use grid::Grid;

use crate::mesh::ScalarType;
use crate::parallel;
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;

/// Maximum number of distinct values of a label map.
pub(crate) const MAX_LABELS: usize = 1000;

/// A scalar image on a regular 3D grid.
///
/// Voxel (i, j, k) has its centre at `to_world · (i, j, k)`, and its value in physical units is
/// `slope · raw + intercept`.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Voxels along i, j, k; each at least 1.
    pub size: [usize; 3],
    /// The stored numbers, i running fastest, then j, then k; their number matches `size`.
    pub raw: Raw,
    /// Factor from stored numbers to physical units.
    pub slope: f64,
    /// Offset added after the factor.
    pub intercept: f64,
    /// From voxel indices to world coordinates, RAS in mm.
    pub to_world: DAffine3,
    /// Names of labels, if stored in the file.
    pub label_names: BTreeMap<i64, String>,
    /// Colours of labels, RGB from 0 to 1, if stored in the file.
    pub label_colours: BTreeMap<i64, [f64; 3]>,
    /// What was repaired or assumed in reading, one sentence each.
    pub notes: Vec<String>,
}

impl Default for Volume {
    /// Returns a volume of one voxel of 1 mm³ with the value 0, at the origin.
    fn default() -> Volume {
        Volume {
            size: [1; 3],
            raw: Raw::U8(vec![0]),
            slope: 1.0,
            intercept: 0.0,
            to_world: DAffine3::IDENTITY,
            label_names: BTreeMap::new(),
            label_colours: BTreeMap::new(),
            notes: Vec::new(),
        }
    }
}

/// Voxels as they are stored.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub enum Raw {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    I64(Vec<i64>),
    U64(Vec<u64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Volume {
    /// Returns the centre of voxel (i, j, k) in the world.
    pub fn centre(&self, i: usize, j: usize, k: usize) -> DVec3 {
        self.grid().centre(i, j, k)
    }

    /// Returns the number of voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// Returns the value of voxel `n`, counted with i running fastest, in physical units.
    ///
    /// # Panics
    /// If `n` is out of range.
    pub fn value(&self, n: usize) -> f64 {
        self.slope * self.raw.get(n) + self.intercept
    }

    /// Returns the distance between the centres of adjacent voxels along i, j and k, in mm.
    pub fn spacing(&self) -> DVec3 {
        self.grid().spacing()
    }

    /// Returns the volume of a voxel, in mm³.
    pub fn voxel_volume(&self) -> f64 {
        self.to_world.matrix3.determinant().abs()
    }

    /// Returns the world-aligned bounding box of all voxels: (lower corner, upper corner).
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.grid().bounds()
    }

    /// Returns the smallest and largest finite value, in physical units; `None` if there is no
    /// finite value.
    pub fn range(&self) -> Option<(f64, f64)> {
        let both = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        let parts = parallel::collect(self.voxels(), |range, parts| {
            let finite = range.map(|n| self.value(n)).filter(|v| v.is_finite());
            parts.extend(finite.map(|v| (v, v)).reduce(both));
        });
        parts.into_iter().reduce(both)
    }

    /// Returns the number of voxels of each label, if this is a label map: integers, at most
    /// 1,000 distinct ones.
    pub fn labels(&self) -> Option<BTreeMap<i64, usize>> {
        let mut counts = BTreeMap::new();
        let mut n = 0;
        while n < self.voxels() {
            let value = self.value(n);
            if value.fract() != 0.0 || value.abs() > 1e15 {
                return None;
            }
            // Labels occur in runs.
            let first = n;
            while n < self.voxels() && self.value(n) == value {
                n += 1;
            }
            *counts.entry(value as i64).or_insert(0) += n - first;
            if counts.len() > MAX_LABELS {
                return None;
            }
        }
        Some(counts)
    }
}

impl Raw {
    /// Returns number `n`, exact except for 64-bit integers beyond 2⁵³.
    ///
    /// # Panics
    /// If `n` is out of range.
    pub fn get(&self, n: usize) -> f64 {
        match self {
            Raw::I8(v) => v[n].into(),
            Raw::U8(v) => v[n].into(),
            Raw::I16(v) => v[n].into(),
            Raw::U16(v) => v[n].into(),
            Raw::I32(v) => v[n].into(),
            Raw::U32(v) => v[n].into(),
            Raw::I64(v) => v[n] as f64,
            Raw::U64(v) => v[n] as f64,
            Raw::F32(v) => v[n].into(),
            Raw::F64(v) => v[n],
        }
    }

    /// Returns the number of stored numbers.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        match self {
            Raw::I8(v) => v.len(),
            Raw::U8(v) => v.len(),
            Raw::I16(v) => v.len(),
            Raw::U16(v) => v.len(),
            Raw::I32(v) => v.len(),
            Raw::U32(v) => v.len(),
            Raw::I64(v) => v.len(),
            Raw::U64(v) => v.len(),
            Raw::F32(v) => v.len(),
            Raw::F64(v) => v.len(),
        }
    }

    /// Returns the type of the numbers.
    pub fn scalar_type(&self) -> ScalarType {
        match self {
            Raw::I8(_) => ScalarType::I8,
            Raw::U8(_) => ScalarType::U8,
            Raw::I16(_) => ScalarType::I16,
            Raw::U16(_) => ScalarType::U16,
            Raw::I32(_) => ScalarType::I32,
            Raw::U32(_) => ScalarType::U32,
            Raw::I64(_) => ScalarType::I64,
            Raw::U64(_) => ScalarType::U64,
            Raw::F32(_) => ScalarType::F32,
            Raw::F64(_) => ScalarType::F64,
        }
    }
}
