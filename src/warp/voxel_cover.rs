//! Rasterises tetrahedra on a voxel grid: finds the tetrahedron of each voxel.
//!
//! Planes are processed in parallel, one thread each: for the tetrahedra whose bounds overlap the
//! plane, row by row, the voxels between the half-planes that bound the cross-section.

use super::tet::{AffineDisplacement, Weights};
use super::{Coverage, MapDirection};
use crate::volume::Grid;
use crate::{Result, parallel};
use glam::DVec3;

/// Marks a voxel outside of all tetrahedra.
const NONE: u32 = u32::MAX;
/// Planes per thread between two writes.
const PLANES_A_THREAD: usize = 4;
/// Padding of bounds and intervals, in voxels; the weights are tested afterwards.
const BOUNDS_MARGIN: f64 = 1e-3;

/// A plane of voxels with their displacements.
pub(super) struct Plane {
    /// Index along the grid's third axis.
    pub k: usize,
    /// Voxels per row.
    pub width: usize,
    /// In mm, world axes, i varying fastest; NaN outside of all tetrahedra.
    pub displacements: Vec<DVec3>,
    pub coverage: Coverage,
}

impl MapDirection<'_> {
    /// Computes `make` for each plane of `grid`, several in parallel, and passes the results to
    /// `take` in order.
    pub(super) fn for_each_plane<T: Send>(
        &self,
        grid: &Grid,
        make: impl Fn(Plane) -> T + Sync,
        take: &mut dyn FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let to_index = grid.to_world.inverse();
        let from = parallel::map(self.from.len(), |v| to_index.transform_point3(self.from[v]));
        let section = Section {
            direction: *self,
            nodes: &from,
            size: grid.size,
        };
        let planes = grid.size[2];
        let slab = (PLANES_A_THREAD * rayon::current_num_threads()).max(1);
        for first in (0..planes).step_by(slab) {
            let last = planes.min(first + slab);
            let tets = section.tets_between(first as f64, last as f64 - 1.0);
            let made =
                parallel::map_coarse(last - first, |n| make(section.plane(first + n, &tets)));
            made.into_iter().try_for_each(&mut *take)?;
        }
        Ok(())
    }
}

/// A body in the voxel coordinates of a grid.
struct Section<'a> {
    direction: MapDirection<'a>,
    nodes: &'a [DVec3],
    size: [usize; 3],
}

impl Section<'_> {
    fn corners(&self, t: u32) -> [DVec3; 4] {
        self.direction.tets[t as usize].map(|v| self.nodes[v as usize])
    }

    /// Returns the valid tetrahedra that overlap planes `low` to `high`, in ascending order.
    fn tets_between(&self, low: f64, high: f64) -> Vec<u32> {
        parallel::collect(self.direction.tets.len(), |range, found| {
            let meets = |t: &u32| {
                let z = self.corners(*t).map(|p| p.z);
                let (least, most) = ends(z);
                self.direction.upright[*t as usize]
                    && least <= high + BOUNDS_MARGIN
                    && most >= low - BOUNDS_MARGIN
            };
            found.extend((range.start as u32..range.end as u32).filter(meets));
        })
    }

    /// Rasterises plane `k`; `tets` must contain all tetrahedra that overlap it.
    fn plane(&self, k: usize, tets: &[u32]) -> Plane {
        let [width, height, _] = self.size;
        let mut owners = vec![NONE; width * height];
        // Number of tetrahedra that contain a voxel strictly inside, up to two.
        let mut inside = vec![0u8; width * height];
        let z = k as f64;
        for &t in tets {
            let corners = self.corners(t);
            let (low, high) = ends(corners.map(|p| p.z));
            if low > z + BOUNDS_MARGIN || high < z - BOUNDS_MARGIN {
                continue;
            }
            let weights = Weights::new(corners);
            let (low, high) = ends(corners.map(|p| p.y));
            for j in whole(low, high, height) {
                let row = DVec3::new(0.0, j as f64, z);
                for i in whole_row(&weights, row, width) {
                    let p = DVec3::new(i as f64, row.y, z);
                    let (holds, within) = weights.contains(weights.at(p));
                    let n = i + width * j;
                    if holds && owners[n] == NONE {
                        owners[n] = t;
                    }
                    if within {
                        inside[n] = (inside[n] + 1).min(2);
                    }
                }
            }
        }
        Plane {
            k,
            width,
            coverage: Coverage {
                voxels: owners.len(),
                uncovered: owners.iter().filter(|t| **t == NONE).count(),
                overlapping: inside.iter().filter(|n| **n > 1).count(),
                beyond: 0,
            },
            displacements: self.shifts(z, &owners),
        }
    }

    /// Returns the displacement of each voxel, from the tetrahedra that contain them.
    fn shifts(&self, z: f64, owners: &[u32]) -> Vec<DVec3> {
        // Consecutive voxels often share a tetrahedron.
        let mut last: Option<(u32, AffineDisplacement)> = None;
        let width = self.size[0];
        let shift = |(n, t): (usize, &u32)| {
            if *t == NONE {
                return DVec3::NAN;
            }
            let shift = match last {
                Some((own, shift)) if own == *t => shift,
                _ => AffineDisplacement::new(
                    &Weights::new(self.corners(*t)),
                    self.direction.corner_displacements(*t),
                ),
            };
            last = Some((*t, shift));
            shift.at(DVec3::new((n % width) as f64, (n / width) as f64, z))
        };
        owners.iter().enumerate().map(shift).collect()
    }
}

/// Returns minimum and maximum of four numbers.
fn ends(of: [f64; 4]) -> (f64, f64) {
    let ends = |(low, high): (f64, f64), x: f64| (low.min(x), high.max(x));
    of.into_iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), ends)
}

/// Returns the integers from `low` to `high` that are below `end`.
fn whole(low: f64, high: f64, end: usize) -> std::ops::Range<usize> {
    let first = (low - BOUNDS_MARGIN).ceil().max(0.0);
    let last = (high + BOUNDS_MARGIN).floor().min(end as f64 - 1.0);
    match first <= last {
        true => first as usize..last as usize + 1,
        false => 0..0,
    }
}

/// Returns the voxels of the row from `row` on whose weights may be non-negative.
fn whole_row(weights: &Weights, row: DVec3, width: usize) -> std::ops::Range<usize> {
    let (mut low, mut high) = (0.0f64, width as f64);
    let start = weights.at(row);
    for ((w, slope), slack) in start.into_iter().zip(weights.gradients).zip(weights.slack) {
        let w = w + slack;
        if slope.x > 0.0 {
            low = low.max(-w / slope.x);
        } else if slope.x < 0.0 {
            high = high.min(-w / slope.x);
        } else if w < 0.0 {
            return 0..0;
        }
    }
    whole(low, high, width)
}
