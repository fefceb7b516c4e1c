//! Grid of a map over a body, or over a part of it.

use super::MapOptions;
use crate::mesh::TetMesh;
use glam::DVec3;

/// A grid seen from above.
#[derive(Clone, Copy, Debug)]
pub(super) struct MapGrid {
    pub axes: [usize; 2],
    pub count: [u32; 2],
    pub low: DVec3,
    pub step: [f64; 2],
}

impl MapGrid {
    /// Covers the bounds of `mesh`, or a square of the wanted side, across `up`.
    pub fn new(mesh: &TetMesh, up: DVec3, wanted: &MapOptions) -> MapGrid {
        let axis = up.abs().max_position();
        let axes = [[1, 2], [0, 2], [0, 1]][axis];
        let (mut low, mut high) = mesh.bounds();
        if let Some(side) = wanted.side {
            let middle = wanted.at.unwrap_or(0.5 * (low + high));
            for k in axes {
                [low[k], high[k]] = [middle[k] - 0.5 * side, middle[k] + 0.5 * side];
            }
        }
        let step = |k: usize| (high - low)[axes[k]] / f64::from(wanted.points[k]);
        MapGrid {
            axes,
            count: wanted.points,
            low,
            step: [step(0), step(1)],
        }
    }

    /// Returns the corners of the box above and below the cells, within the bounds of `mesh`.
    pub fn bounds(&self, mesh: &TetMesh) -> (DVec3, DVec3) {
        let (mut low, mut high) = mesh.bounds();
        for (k, axis) in self.axes.into_iter().enumerate() {
            let end = self.low[axis] + self.step[k] * f64::from(self.count[k]);
            low[axis] = low[axis].max(self.low[axis]);
            high[axis] = high[axis].min(end);
        }
        (low, high)
    }

    /// Returns the centre of a cell.
    pub fn middle(&self, cell: usize) -> DVec3 {
        let across = self.count[0] as usize;
        let mut middle = self.low;
        for (k, number) in [cell % across, cell / across].into_iter().enumerate() {
            middle[self.axes[k]] += (number as f64 + 0.5) * self.step[k];
        }
        middle
    }

    /// Returns the number of cells.
    pub fn len(&self) -> usize {
        self.count[0] as usize * self.count[1] as usize
    }

    /// Returns the four cells whose centres surround a position, with bilinear weights.
    pub fn around(&self, p: DVec3) -> [(usize, f64); 4] {
        let mut low = [0usize; 2];
        let mut share = [0.0; 2];
        for k in 0..2 {
            let axis = self.axes[k];
            let last = f64::from(self.count[k] - 1);
            let at = ((p[axis] - self.low[axis]) / self.step[k] - 0.5).clamp(0.0, last);
            low[k] = at.floor().min((last - 1.0).max(0.0)) as usize;
            share[k] = at - low[k] as f64;
        }
        let most = self.count.map(|n| n as usize - 1);
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|corner| {
            let at = |k: usize| (low[k] + corner[k]).min(most[k]);
            let weight = |k: usize| match corner[k] {
                0 => 1.0 - share[k],
                _ => share[k],
            };
            (
                at(0) + self.count[0] as usize * at(1),
                weight(0) * weight(1),
            )
        })
    }
}
