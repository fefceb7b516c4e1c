//! Geometry of a voxel grid.

use super::Volume;
use glam::{DAffine3, DVec3};

/// A regular 3D grid and its position in the world. Two images with equal grids can be compared
/// voxel by voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Voxels along i, j, k; each at least 1.
    pub size: [usize; 3],
    /// From voxel indices to world coordinates, RAS in mm: voxel (i, j, k) has its centre at
    /// `to_world · (i, j, k)`.
    pub to_world: DAffine3,
}

impl Grid {
    /// Returns the number of voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// Returns the centre of voxel (i, j, k) in the world.
    pub fn centre(&self, i: usize, j: usize, k: usize) -> DVec3 {
        let index = DVec3::new(i as f64, j as f64, k as f64);
        self.to_world.transform_point3(index)
    }

    /// Returns the distance between the centres of adjacent voxels along i, j and k, in mm.
    pub fn spacing(&self) -> DVec3 {
        let axes = self.to_world.matrix3;
        DVec3::new(
            axes.x_axis.length(),
            axes.y_axis.length(),
            axes.z_axis.length(),
        )
    }

    /// Returns the world-aligned bounding box of all voxels: (lower corner, upper corner).
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let far = DVec3::from(self.size.map(|n| n as f64 - 0.5));
        let corners = (0..8).map(|n| {
            let end = |axis: usize| n >> axis & 1 == 1;
            let at = |axis: usize| if end(axis) { far[axis] } else { -0.5 };
            self.to_world
                .transform_point3(DVec3::new(at(0), at(1), at(2)))
        });
        crate::mesh::bounds(&corners.collect::<Vec<_>>())
    }
}

impl Volume {
    /// Returns its voxel grid.
    pub fn grid(&self) -> Grid {
        Grid {
            size: self.size,
            to_world: self.to_world,
        }
    }
}
