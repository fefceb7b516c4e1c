//! Maps single points between the states of a body.

use super::tet::{AffineDisplacement, Weights};
use super::{MapDirection, Warp};
use crate::mesh::{Bvh, bounds_union};
use glam::DVec3;

/// Padding of a tetrahedron's bounding box as a fraction of its extent, against rounding.
const ROOM: f64 = 1e-6;

impl Warp<'_> {
    /// Maps `p` from the state `from` to the other one.
    pub(super) fn map_point(&self, from: usize, p: DVec3) -> Option<DVec3> {
        if !p.is_finite() {
            return None;
        }
        let map_direction = self.direction(from);
        let search = self.search[from].get_or_init(|| map_direction.search());
        let mut first = None;
        search.for_each_overlapping(&[p, p], |t| {
            let sooner = first.is_none_or(|(own, _)| t < own);
            if sooner && map_direction.upright[t as usize] {
                let weights = Weights::new(map_direction.corners(t));
                if weights.contains(weights.at(p)).0 {
                    first = Some((t, weights));
                }
            }
        });
        let (t, weights) = first?;
        Some(p + AffineDisplacement::new(&weights, map_direction.corner_displacements(t)).at(p))
    }
}

impl MapDirection<'_> {
    pub(super) fn corners(&self, t: u32) -> [DVec3; 4] {
        self.tets[t as usize].map(|v| self.from[v as usize])
    }

    /// Returns the displacements of the corners of a tetrahedron.
    pub(super) fn corner_displacements(&self, t: u32) -> [DVec3; 4] {
        self.tets[t as usize].map(|v| self.to[v as usize] - self.from[v as usize])
    }

    fn search(&self) -> Bvh {
        let middle = |t: usize| 0.25 * self.corners(t as u32).iter().sum::<DVec3>();
        let mut search = Bvh::new(self.tets.len(), middle);
        search.refit(|t| {
            let corners = self.corners(t as u32).map(|p| [p, p]);
            let [low, high] = corners.into_iter().reduce(bounds_union).unwrap_or_default();
            let room = DVec3::splat(ROOM * (high - low).max_element());
            [low - room, high + room]
        });
        search
    }
}
