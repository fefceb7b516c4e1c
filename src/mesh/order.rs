//! Morton order: tets close in space are close in memory, which improves the cache hit rate of a
//! raycaster.

use super::TetMesh;
use crate::parallel;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// Bits of the Morton code along each axis; three of them fit 64 bits.
const BITS: u32 = 21;

impl TetMesh {
    /// Returns the order in which to visit the tets of `mesh` so that neighbours in space stay close:
    /// the k-th entry is the k-th tet along the Morton curve through the centroids.
    ///
    /// Equal codes keep the order of the file, so the result is deterministic.
    pub fn morton_order(&self) -> Vec<u32> {
        order_of(self.tets.len(), self.bounds(), |t| {
            self.tet_nodes(t).into_iter().sum::<DVec3>() / 4.0
        })
    }
}

/// Returns the order of `count` points within a box along the Morton curve.
pub(crate) fn order_of(
    count: usize,
    (low, high): (DVec3, DVec3),
    point: impl Fn(usize) -> DVec3 + Sync,
) -> Vec<u32> {
    let extent = (high - low).max_element();
    let cells = ((1u64 << BITS) - 1) as f64;
    let scale = if extent > 0.0 { cells / extent } else { 0.0 };
    let mut keyed = parallel::map(count, |k| (morton_code((point(k) - low) * scale), k as u32));
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, t)| t).collect()
}

/// Interleaves the bits of a point with coordinates in [0, 2²¹).
fn morton_code(p: DVec3) -> u64 {
    spread(p.x as u64) | spread(p.y as u64) << 1 | spread(p.z as u64) << 2
}

/// Moves bit k of the lowest 21 bits to bit 3k.
fn spread(x: u64) -> u64 {
    let mut x = x & 0x1f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}
