//! A scan for light paths in float64, and where rays cross its isosurfaces.

use crate::volume::Volume;
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Parts of a voxel's length in which crossings are sought, and halvings that refine one.
const PARTS: f64 = 4.0;
const HALVINGS: usize = 40;

/// A scan whose values are shares of the range.
pub(super) struct ReferenceScan {
    pub volume: Arc<Volume>,
    /// Maps rest positions in the local frame to voxels.
    pub voxel_from_rest: DAffine3,
}

impl ReferenceScan {
    /// Whether the scan has values at a rest position.
    pub fn covers(&self, rest: DVec3) -> bool {
        let voxel = self.voxel_from_rest.transform_point3(rest);
        let last = DVec3::from(self.volume.size.map(|n| n as f64 - 0.5));
        voxel.cmpge(DVec3::splat(-0.5)).all() && voxel.cmple(last).all()
    }

    pub fn value(&self, rest: DVec3) -> f64 {
        let voxel = self.voxel_from_rest.transform_point3(rest);
        self.volume.at_index(voxel)
    }

    /// Returns the gradient at a rest position in a tet: over two voxels, in the deformed body.
    pub fn gradient(&self, rest: DVec3, rest_from_place: DMat3) -> DVec3 {
        let voxel = self.voxel_from_rest.transform_point3(rest);
        let along = |axis: DVec3| {
            0.5 * (self.volume.at_index(voxel + axis) - self.volume.at_index(voxel - axis))
        };
        let steep = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        let at_rest = self.voxel_from_rest.matrix3.transpose() * steep;
        rest_from_place.transpose() * at_rest
    }

    /// Returns the shares of the line between two rest positions at which the scan has `value`.
    pub fn crossings(&self, [front, back]: [DVec3; 2], value: f64) -> Vec<f64> {
        let voxels = self.voxel_from_rest.transform_vector3(back - front);
        let parts = (voxels.length() * PARTS).ceil().max(1.0) as usize;
        let at = |u: f64| front.lerp(back, u);
        let is_below = |u: f64| self.value(at(u)) < value;
        let mut found = Vec::new();
        for n in 0..parts {
            let mut ends = [n, n + 1].map(|n| n as f64 / parts as f64);
            let below = is_below(ends[0]);
            if below == is_below(ends[1]) {
                continue;
            }
            for _ in 0..HALVINGS {
                let middle = 0.5 * (ends[0] + ends[1]);
                ends[usize::from(is_below(middle) != below)] = middle;
            }
            if self.covers(at(ends[1])) {
                found.push(ends[1]);
            }
        }
        found
    }
}
