//! A balanced octree over a domain: the smallest leaves along all region boundaries, larger ones
//! away from them; or leaves of wanted sizes.

use super::{Domain, SizeField};
use crate::parallel;
use crate::progress::ProgressScope;
use crate::{Error, Result};
use glam::DVec3;
use rayon::slice::ParallelSliceMut;
use rustc_hash::FxHashMap;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bits of a lattice coordinate; three of them fit 64.
const BITS: u32 = 21;

/// The level of the largest leaves in the search of empty space: 2⁵ times the smallest.
const SEARCH_LEVEL: u32 = 5;

/// Maximum number of leaves of a lattice, with about twelve tets each.
const MAX_LEAVES: usize = 1 << 25;

/// A point of the lattice, in half edges of the smallest leaf.
pub(super) type Lattice = [u32; 3];

/// A cube of the octree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// Its lower corner; all coordinates are multiples of its [`side`].
    pub corner: Lattice,
    /// The smallest leaves have level 0; each level doubles the size.
    pub level: u32,
    /// The region that contains all of it, if known.
    pub region: Option<u16>,
}

/// Which sizes leaves have.
#[derive(Clone, Copy)]
pub(super) enum LeafSizes<'a> {
    /// The smallest along boundaries, and up to 2 to this power times as large away from them.
    Graded(u32),
    /// Those of a field, in proportion to its smallest.
    Field(&'a SizeField),
}

impl LeafSizes<'_> {
    /// Largest level of a leaf.
    fn levels(self) -> u32 {
        match self {
            LeafSizes::Graded(levels) => levels,
            LeafSizes::Field(sizes) => sizes.levels(),
        }
    }
}

/// The leaves of an octree in Morton order.
pub(super) struct Octree {
    pub leaves: Vec<Leaf>,
    /// Whether leaves have the sizes of a field, also at boundaries.
    pub follows_field: bool,
    /// For each level, the index of a leaf in `leaves` by the key of its corner.
    index: Vec<FxHashMap<u64, u32>>,
    origin: DVec3,
    half: f64,
}

/// Returns the side of a leaf in half edges.
pub(super) fn side(level: u32) -> u32 {
    2 << level
}

/// Packs a lattice point into one integer, in the order z, y, x.
pub(super) fn key(p: Lattice) -> u64 {
    u64::from(p[0]) | u64::from(p[1]) << BITS | u64::from(p[2]) << (2 * BITS)
}

impl Octree {
    /// Builds the octree over `domain` with smallest leaves of side `edge`. Its planes pass through
    /// the lower corner of the domain's bounds, moved by `offset` edges. Leaves outside, and not adjacent to a region, are dropped.
    pub(super) fn new(
        domain: &dyn Domain,
        edge: f64,
        sizes: LeafSizes,
        offset: DVec3,
        part: &ProgressScope,
    ) -> Result<Octree> {
        let levels = sizes.levels();
        let (low, high) = domain.bounds();
        let extent = high - low;
        if !(extent.is_finite() && extent.min_element() >= 0.0) {
            return Err(Error::Input(
                "nothing to mesh: no voxel or point is inside a region".into(),
            ));
        }
        // A margin of two cells on each side, and a third for the offset.
        let origin = low + (offset - 3.0) * edge;
        let top = levels.max(SEARCH_LEVEL);
        let across = ((extent / edge).max_element() + 7.0) / f64::from(1u32 << top);
        if edge <= 0.0 || (across + 1.0) * f64::from(side(top)) >= f64::from(1u32 << BITS) {
            return Err(Error::Input(format!(
                "edge length for a body of size {extent} must be between {:.3e} and {:.3e}, got \
                {edge}",
                extent.max_element() / f64::from(1u32 << (BITS - 2)),
                extent.max_element()
            )));
        }
        let blocks = ((extent / edge + 7.0) / f64::from(1u32 << top))
            .to_array()
            .map(|n| n.floor() as usize + 1);
        let mut tree = Octree {
            leaves: Vec::new(),
            follows_field: matches!(sizes, LeafSizes::Field(_)),
            index: vec![FxHashMap::default(); levels as usize + 1],
            origin,
            half: 0.5 * edge,
        };
        let made = AtomicUsize::new(0);
        let leaves = parallel::map_coarse(blocks.iter().product(), |b| {
            let block = [
                b % blocks[0],
                b / blocks[0] % blocks[1],
                b / blocks[0] / blocks[1],
            ];
            let root = Leaf {
                corner: block.map(|i| i as u32 * side(top)),
                level: top,
                region: None,
            };
            let mut leaves = Vec::new();
            if part.should_continue() {
                tree.divide((domain, sizes), root, &made, &mut leaves);
            }
            leaves
        });
        part.check_cancelled()?;
        if made.into_inner() > MAX_LEAVES {
            return Err(Error::Input(format!(
                "edge length {edge} gives more than {} million tets; increase it",
                12 * (MAX_LEAVES >> 20)
            )));
        }
        for leaf in leaves.into_iter().flatten() {
            tree.leaves.push(leaf);
        }
        tree.balance(levels);
        part.check_cancelled()?;
        tree.leaves.par_sort_unstable_by_key(|l| morton(l.corner));
        for (i, leaf) in tree.leaves.iter().enumerate() {
            tree.index[leaf.level as usize].insert(key(leaf.corner), i as u32);
        }
        Ok(tree)
    }

    /// Returns the position of a lattice point.
    pub(super) fn position(&self, p: Lattice) -> DVec3 {
        self.origin + DVec3::from(p.map(f64::from)) * self.half
    }

    /// Returns the leaf of that level with that corner.
    pub(super) fn find(&self, corner: Lattice, level: u32) -> Option<u32> {
        self.index.get(level as usize)?.get(&key(corner)).copied()
    }

    /// Adds the leaves of `cell` to `leaves`, subdivided where smaller ones are wanted.
    fn divide(
        &self,
        (domain, sizes): (&dyn Domain, LeafSizes),
        cell: Leaf,
        made: &AtomicUsize,
        leaves: &mut Vec<Leaf>,
    ) {
        if made.load(Ordering::Relaxed) > MAX_LEAVES {
            return;
        }
        let edge = 2.0 * self.half;
        // Tets connect the centres of adjacent leaves, of which the larger has at most the largest size.
        let reach = match sizes {
            LeafSizes::Graded(_) => edge,
            LeafSizes::Field(_) => edge * f64::from(1u32 << sizes.levels()),
        };
        let region = cell.region.or_else(|| {
            // With a margin of one edge, a leaf adjacent to one with a boundary is subdivided, too.
            let low = self.position(cell.corner) - reach;
            let high = self.position(cell.corner.map(|c| c + side(cell.level))) + reach;
            domain.uniform(low, high)
        });
        if region == Some(0) {
            return;
        }
        let is_leaf = match sizes {
            LeafSizes::Graded(levels) => cell.level <= levels && region.is_some(),
            LeafSizes::Field(sizes) => {
                cell.level <= sizes.levels() && !self.is_too_large(cell, sizes)
            }
        };
        if cell.level == 0 || is_leaf {
            made.fetch_add(1, Ordering::Relaxed);
            leaves.push(Leaf { region, ..cell });
            return;
        }
        for child in (Leaf { region, ..cell }).children() {
            self.divide((domain, sizes), child, made, leaves);
        }
    }

    /// Whether the half of its side is nearer to a wanted size, by their ratio, than its side.
    fn is_too_large(&self, cell: Leaf, sizes: &SizeField) -> bool {
        let low = self.position(cell.corner);
        let high = self.position(cell.corner.map(|c| c + side(cell.level)));
        let length = sizes.smallest() * f64::from(1u32 << cell.level);
        sizes.is_finer_in(low, high, length * std::f64::consts::FRAC_1_SQRT_2)
    }

    /// Subdivides leaves until those that share an edge or a face differ by at most one level.
    fn balance(&mut self, levels: u32) {
        if levels < 2 {
            return;
        }
        let mut large: Vec<FxHashMap<u64, Option<u16>>> =
            vec![FxHashMap::default(); levels as usize + 1];
        for leaf in self.leaves.iter().filter(|l| l.level > 1) {
            large[leaf.level as usize].insert(key(leaf.corner), leaf.region);
        }
        let mut waiting = std::mem::take(&mut self.leaves);
        let mut small = Vec::with_capacity(waiting.len());
        while let Some(leaf) = waiting.pop() {
            let is_large = leaf.level > 1;
            // It may have been subdivided since.
            if is_large && !large[leaf.level as usize].contains_key(&key(leaf.corner)) {
                continue;
            }
            let mut divided = false;
            for level in leaf.level + 2..=levels {
                for corner in ancestors_beside(leaf, level) {
                    let Some(region) = large[level as usize].remove(&key(corner)) else {
                        continue;
                    };
                    let parent = Leaf {
                        corner,
                        level,
                        region,
                    };
                    for child in parent.children() {
                        if child.level > 1 {
                            large[child.level as usize].insert(key(child.corner), child.region);
                        }
                        waiting.push(child);
                    }
                    divided = true;
                }
            }
            if divided {
                // The adjacent child may still be too large.
                waiting.push(leaf);
            } else if !is_large {
                small.push(leaf);
            }
        }
        self.leaves = small;
        for (level, leaves) in large.into_iter().enumerate() {
            self.leaves
                .extend(leaves.into_iter().map(|(key, region)| Leaf {
                    corner: from_key(key),
                    level: level as u32,
                    region,
                }));
        }
    }
}

impl Leaf {
    fn children(self) -> impl Iterator<Item = Leaf> {
        let step = side(self.level) / 2;
        (0..8).map(move |n| Leaf {
            corner: [0, 1, 2].map(|axis| self.corner[axis] + (n >> axis & 1) * step),
            level: self.level - 1,
            region: self.region,
        })
    }
}

/// Returns the corners of cells of `level` that contain a face or edge neighbour of `leaf`, but not
/// the leaf itself.
fn ancestors_beside(leaf: Leaf, level: u32) -> impl Iterator<Item = Lattice> {
    let (own, wide) = (side(leaf.level), side(level));
    let holder = move |p: Lattice| p.map(|c| c / wide * wide);
    let home = holder(leaf.corner);
    (0..27u32).filter_map(move |n| {
        let step = [n % 3, n / 3 % 3, n / 9];
        let steps = step.iter().filter(|s| **s != 1).count();
        if steps == 0 || steps == 3 {
            return None;
        }
        let mut at = leaf.corner;
        for axis in 0..3 {
            at[axis] = (at[axis] + step[axis] * own).checked_sub(own)?;
        }
        let cell = holder(at);
        (cell != home).then_some(cell)
    })
}

fn from_key(key: u64) -> Lattice {
    [0, 1, 2].map(|axis| (key >> (axis * BITS)) as u32 & ((1 << BITS) - 1))
}

/// Returns the Morton code of a lattice point.
fn morton(p: Lattice) -> u64 {
    let spread = |x: u32| {
        let mut x = u64::from(x);
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    spread(p[0]) | spread(p[1]) << 1 | spread(p[2]) << 2
}
