//! Displacement fields on a voxel grid.

use super::voxel_cover::Plane;
use super::{Coverage, MapDirection, Warp};
use crate::Result;
use crate::volume::Grid;
use glam::DVec3;

/// A displacement field: the displacement of the material at each voxel centre.
#[derive(Clone, Debug)]
pub struct DisplacementField {
    /// Voxel grid.
    pub grid: Grid,
    /// One vector a voxel, i varying fastest, then j, then k: in mm along the world axes, RAS. 0
    /// outside of all tetrahedra. (Files store them in LPS, as ITK expects.)
    pub vectors: Vec<[f32; 3]>,
    /// Coverage of the grid by the body in the source state.
    pub coverage: Coverage,
}

impl Warp<'_> {
    /// Computes the displacement from rest to the deformed state on `grid`, whose voxels are
    /// positions in the body at rest.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if no voxel lies in the body.
    pub fn displacement(&self, grid: &Grid) -> Result<DisplacementField> {
        self.forward().field(grid)
    }

    /// Computes the displacement from the deformed state to rest on `grid`, whose voxels are
    /// positions in the deformed body: resampling an image of the body at rest by it gives an image
    /// of the deformed body.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if no voxel lies in the body.
    pub fn inverse(&self, grid: &Grid) -> Result<DisplacementField> {
        self.backward().field(grid)
    }
}

impl MapDirection<'_> {
    fn field(&self, grid: &Grid) -> Result<DisplacementField> {
        let mut field = DisplacementField {
            grid: *grid,
            vectors: Vec::with_capacity(grid.voxels()),
            coverage: Coverage::default(),
        };
        let make = |plane: Plane| (vectors(&plane), plane.coverage);
        self.for_each_plane(grid, make, &mut |(vectors, coverage)| {
            field.vectors.extend(vectors);
            field.coverage.add(coverage);
            Ok(())
        })?;
        field.coverage.require_any(self, grid)?;
        Ok(field)
    }
}

/// Returns the vectors of a plane.
fn vectors(plane: &Plane) -> Vec<[f32; 3]> {
    let vector = |shift: &DVec3| match shift.is_nan() {
        true => [0.0; 3],
        false => shift.as_vec3().to_array(),
    };
    plane.displacements.iter().map(vector).collect()
}

/// Returns the vectors of a plane as bytes of a file, in LPS.
pub(super) fn lps(plane: &Plane) -> Vec<u8> {
    let vectors = vectors(plane).into_iter();
    // Subtraction from 0 instead of negation avoids −0.
    let turned = vectors.flat_map(|[x, y, z]| [0.0 - x, 0.0 - y, z]);
    turned.flat_map(f32::to_le_bytes).collect()
}
