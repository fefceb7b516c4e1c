//! Min-max pyramid of a scan for empty-space skipping: the smallest and largest value per block of
//! texels and per block of blocks. Built once; independent of the deformation.

use super::texture::Texels;
use crate::mesh::TetMesh;
use crate::parallel;
use glam::{DAffine3, DVec3};

/// Texels along each axis of a block on the finest level.
const BLOCK: usize = 4;
/// Maximum number of blocks along each axis that one query visits.
const MAX_BLOCKS_PER_QUERY: usize = 4;

/// Smallest and largest texel of each block of a level.
struct Level {
    size: [usize; 3],
    ends: Vec<[f32; 2]>,
}

/// Min-max pyramid of the texels of a scan.
pub(super) struct MinMaxPyramid {
    texels: [usize; 3],
    levels: Vec<Level>,
}

impl MinMaxPyramid {
    pub fn new(texels: &Texels) -> MinMaxPyramid {
        let mut levels = vec![Level::of(texels.size, BLOCK, |n| {
            let texel = f32::from(texels.values[n]);
            [texel, texel]
        })];
        while let Some(last) = levels.last()
            && last.size.iter().any(|n| *n > 1)
        {
            let next = Level::of(last.size, 2, |n| last.ends[n]);
            levels.push(next);
        }
        MinMaxPyramid {
            texels: texels.size,
            levels,
        }
    }

    /// Returns the range of all texels in or next to the box from `low` to `high`; `None` if the
    /// box is outside the scan.
    fn between(&self, low: DVec3, high: DVec3) -> Option<[f32; 2]> {
        let mut range = [[0usize; 2]; 3];
        for k in 0..3 {
            let last = self.texels[k] as f64 - 1.0;
            if !(high[k] >= -0.5 && low[k] <= last + 0.5) {
                return None;
            }
            let end = |x: f64| x.clamp(0.0, last) as usize;
            range[k] = [end(low[k].floor()), end(high[k].floor() + 1.0)];
        }
        let mut block = BLOCK;
        let mut level = 0;
        while level + 1 < self.levels.len()
            && range
                .iter()
                .any(|[a, b]| b / block - a / block >= MAX_BLOCKS_PER_QUERY)
        {
            (block, level) = (2 * block, level + 1);
        }
        let Level { size, ends } = &self.levels[level];
        let [x, y, z] = range.map(|[a, b]| a / block..=b / block);
        let mut found = [f32::INFINITY, f32::NEG_INFINITY];
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let block_ends = ends[i + size[0] * (j + size[1] * k)];
                    found = [found[0].min(block_ends[0]), found[1].max(block_ends[1])];
                }
            }
        }
        Some(found)
    }

    /// Returns the texel range in each tet of `mesh` in the rest configuration; `None` where the
    /// scan does not cover the tet.
    pub fn tet_ranges(&self, mesh: &TetMesh, texel_from_rest: DAffine3) -> Vec<Option<[f32; 2]>> {
        parallel::map(mesh.tets.len(), |t| {
            let corners = mesh
                .tet_nodes(t)
                .map(|p| texel_from_rest.transform_point3(p));
            let (low, high) = crate::mesh::bounds(&corners);
            self.between(low, high)
        })
    }
}

impl Level {
    /// Builds a level from an array of the given size, with `block` items along each axis of a
    /// block.
    fn of(
        [nx, ny, nz]: [usize; 3],
        block: usize,
        item: impl Fn(usize) -> [f32; 2] + Sync,
    ) -> Level {
        let size = [nx, ny, nz].map(|n| n.div_ceil(block));
        let ends = parallel::map(size.iter().product(), |n| {
            let low = [n % size[0], n / size[0] % size[1], n / size[0] / size[1]];
            let along = |k: usize, n: usize| low[k] * block..((low[k] + 1) * block).min(n);
            let mut found = [f32::INFINITY, f32::NEG_INFINITY];
            for z in along(2, nz) {
                for y in along(1, ny) {
                    for x in along(0, nx) {
                        let own = item(x + nx * (y + ny * z));
                        found = [found[0].min(own[0]), found[1].max(own[1])];
                    }
                }
            }
            found
        });
        Level { size, ends }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use half::f16;

    #[test]
    fn pyramid_bounds_contain_all_samples() {
        let size = [21, 13, 9];
        // Increases along x, with added noise.
        let texel = |n: usize| {
            let noise = ((n * 7919) % 1013) as f64 / 1013.0;
            0.9 * (n % size[0]) as f64 / 20.0 + 0.1 * noise
        };
        let values: Vec<f16> = (0..size.iter().product())
            .map(|n| f16::from_f64(texel(n)))
            .collect();
        let pyramid = MinMaxPyramid::new(&Texels {
            downsampling: [1; 3],
            size,
            values: values.clone(),
            ends: (0.0, 1.0),
            label_index: None,
            first: 0,
        });
        let mut random = 1u64;
        let mut next = || {
            random = random.wrapping_mul(6364136223846793005).wrapping_add(1);
            (random >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut narrow = 0;
        for _ in 0..300 {
            let mut corner = || DVec3::from(size.map(|n| next() * (n as f64 + 2.0) - 1.0));
            let (a, b) = (corner(), corner());
            let Some([low, high]) = pyramid.between(a.min(b), a.max(b)) else {
                continue;
            };
            for _ in 0..20 {
                let p = a + (b - a) * DVec3::new(next(), next(), next());
                let at = [0, 1, 2].map(|k| (p[k].round().max(0.0) as usize).min(size[k] - 1));
                let value = f32::from(values[at[0] + size[0] * (at[1] + size[1] * at[2])]);
                assert!((low..=high).contains(&value), "{value} of [{low}, {high}]");
            }
            narrow += usize::from(high - low < 0.6);
        }
        assert!(narrow > 20, "too few narrow bounds: {narrow}");
        assert!(
            pyramid
                .between(DVec3::splat(-3.0), DVec3::splat(-0.6))
                .is_none()
        );
    }
}
