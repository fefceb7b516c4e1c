//! Motions as vectors on a grid.

use super::voxel_cover::Plane;
use super::{Coverage, MapDirection, Warp};
use crate::Result;
use crate::volume::Grid;
use glam::DVec3;

/// A motion on a grid: how far the matter at each voxel's centre goes.
#[derive(Clone, Debug)]
pub struct DisplacementField {
    /// Where the voxels are.
    pub grid: Grid,
    /// One a voxel, i running fastest, then j, then k: in mm along the axes of the world, RAS. 0
    /// where no tet is. (Files have them in LPS, as ITK takes them.)
    pub vectors: Vec<[f32; 3]>,
    /// How the voxels lie in the body that the motion starts from.
    pub coverage: Coverage,
}

impl Warp<'_> {
    /// The motion from rest to bent on `grid`, whose voxels are places of the body at rest.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) when no voxel lies in the body.
    pub fn displacement(&self, grid: &Grid) -> Result<DisplacementField> {
        self.forward().field(grid)
    }

    /// The motion from bent to rest on `grid`, whose voxels are places of the bent body: a picture
    /// of the body at rest, resampled by it, is one of the bent body.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) when no voxel lies in the body.
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

/// The vectors of a plane.
fn vectors(plane: &Plane) -> Vec<[f32; 3]> {
    let vector = |shift: &DVec3| match shift.is_nan() {
        true => [0.0; 3],
        false => shift.as_vec3().to_array(),
    };
    plane.displacements.iter().map(vector).collect()
}

/// The same as bytes of a file, in LPS.
pub(super) fn lps(plane: &Plane) -> Vec<u8> {
    let vectors = vectors(plane).into_iter();
    // Less nothing, so that there is no −0.
    let turned = vectors.flat_map(|[x, y, z]| [0.0 - x, 0.0 - y, z]);
    turned.flat_map(f32::to_le_bytes).collect()
}
