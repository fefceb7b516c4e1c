//! Float64 reference sampling of scans along exact rays.

use super::Scan;
use crate::mesh::TetMesh;
use crate::render::Segment;
use crate::volume::Volume;
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A scan of values sampled by [`ReferenceRaycaster`](crate::render::ReferenceRaycaster).
pub(in crate::render) struct ScanReference {
    volume: Arc<Volume>,
    voxel_from_rest: DAffine3,
    /// Rest positions of the corners of each tet.
    rests: Vec<[DVec3; 4]>,
    range: (f64, f64),
    /// Number of sub-segments per voxel length.
    fine: f64,
}

impl ScanReference {
    pub fn new(mesh: &TetMesh, scan: &Scan, fine: f64) -> ScanReference {
        ScanReference {
            volume: scan.volume.clone(),
            voxel_from_rest: scan.rest_to_voxel(),
            rests: (0..mesh.tets.len()).map(|t| mesh.tet_nodes(t)).collect(),
            range: scan.range(),
            fine,
        }
    }

    /// Splits the ray segment `whole` of a tet, with the given barycentric weights at its ends,
    /// into sub-segments of the configured length; parts outside the scan are omitted.
    pub fn split(&self, whole: Segment, weights: [[f64; 4]; 2]) -> Vec<Segment> {
        let rests = self.rests[whole.tet as usize];
        let [front, back] = weights.map(|w| {
            let rest: DVec3 = (0..4).map(|k| w[k] * rests[k]).sum();
            self.voxel_from_rest.transform_point3(rest)
        });
        let count = (front.distance(back) * self.fine).ceil().max(1.0) as usize;
        let at = |n: f64| n / count as f64;
        let last = DVec3::from(self.volume.size.map(|n| n as f64 - 0.5));
        let value = |u: f64| {
            let s = self.volume.at_index(front + u * (back - front));
            s.clamp(self.range.0, self.range.1)
        };
        let parts = (0..count).filter_map(|n| {
            let u = [at(n as f64), at(n as f64 + 1.0)];
            let middle = front + 0.5 * (u[0] + u[1]) * (back - front);
            let covered = middle.cmpge(DVec3::splat(-0.5)).all() && middle.cmple(last).all();
            covered.then(|| Segment {
                t: u.map(|u| whole.t[0] + u * (whole.t[1] - whole.t[0])),
                s: u.map(value),
                tet: whole.tet,
            })
        });
        parts.collect()
    }
}
