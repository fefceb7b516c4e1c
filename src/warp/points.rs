//! Single points of a body.

use super::tet::{Shift, Weights};
use super::{Warp, Way};
use crate::mesh::{Hierarchy, around};
use glam::DVec3;

/// Share of its extent that a tet's box is widened by, so that rounding takes no place from it.
const ROOM: f64 = 1e-6;

impl Warp<'_> {
    /// Where the matter at `p` of the state `from` is in the other.
    pub(super) fn at(&self, from: usize, p: DVec3) -> Option<DVec3> {
        if !p.is_finite() {
            return None;
        }
        let way = self.way(from);
        let search = self.search[from].get_or_init(|| way.search());
        let mut first = None;
        search.visit(&[p, p], |t| {
            let sooner = first.is_none_or(|(own, _)| t < own);
            if sooner && way.upright[t as usize] {
                let weights = Weights::new(way.corners(t));
                if weights.hold(weights.at(p)).0 {
                    first = Some((t, weights));
                }
            }
        });
        let (t, weights) = first?;
        Some(p + Shift::new(&weights, way.shifts(t)).at(p))
    }
}

impl Way<'_> {
    pub(super) fn corners(&self, t: u32) -> [DVec3; 4] {
        self.tets[t as usize].map(|v| self.from[v as usize])
    }

    /// How far the corners of a tet go.
    pub(super) fn shifts(&self, t: u32) -> [DVec3; 4] {
        self.tets[t as usize].map(|v| self.to[v as usize] - self.from[v as usize])
    }

    fn search(&self) -> Hierarchy {
        let middle = |t: usize| 0.25 * self.corners(t as u32).iter().sum::<DVec3>();
        let mut search = Hierarchy::new(self.tets.len(), middle);
        search.refit(|t| {
            let corners = self.corners(t as u32).map(|p| [p, p]);
            let [low, high] = corners.into_iter().reduce(around).unwrap_or_default();
            let room = DVec3::splat(ROOM * (high - low).max_element());
            [low - room, high + room]
        });
        search
    }
}
