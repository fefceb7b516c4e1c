//! Volumes: images of the inside of a body on a regular grid, placed in the world.
//!
//! The world frame is RAS in millimetres: x grows to the patient’s **R**ight, y to the
//! **A**nterior, z to the **S**uperior. Readers bring everything there.

use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;

/// A scalar image on a regular 3D grid.
///
/// Voxel (i, j, k) has its centre at `to_world · (i, j, k)`, and its value in physical units is
/// `slope · raw + intercept`.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Voxels along i, j, k; each at least 1.
    pub size: [usize; 3],
    /// The stored numbers, i running fastest, then j, then k; as many as `size` says.
    pub raw: Raw,
    /// Factor from stored numbers to physical units.
    pub slope: f64,
    /// Added after the factor.
    pub intercept: f64,
    /// From voxel indices to world coordinates, RAS in mm.
    pub to_world: DAffine3,
    /// Names of labels, where the file has them.
    pub names: BTreeMap<i64, String>,
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
    /// The centre of voxel (i, j, k) in the world.
    pub fn centre(&self, i: usize, j: usize, k: usize) -> DVec3 {
        let index = DVec3::new(i as f64, j as f64, k as f64);
        self.to_world.transform_point3(index)
    }
}
