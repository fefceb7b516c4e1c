//! The tets of an octree: a body-centred cubic lattice between equal leaves, and a transition
//! between leaves of different sizes.
//!
//! After Labelle & Shewchuk, *Isosurface stuffing* (2007), section 4. A tet connects the centres of
//! two leaves and an edge of the face between them, halved if smaller leaves have a point there;
//! between leaves of different sizes the smaller faces, each split along the diagonal from the
//! centre of the large face, are connected to both centres.

use super::octree::{Lattice, Leaf, Octree, key, side};
use crate::parallel;
use crate::progress::ProgressScope;
use crate::{Error, Result};
use glam::DVec3;
use rustc_hash::FxHashMap;

/// The corners of the face of a leaf on the upper side of an axis, in cyclic order.
const FACE_CORNERS: [[u32; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];

/// The points and tets of an octree.
pub(super) struct LatticeMesh {
    /// The points in lattice coordinates.
    pub points: Vec<Lattice>,
    /// Their positions in space.
    pub positions: Vec<DVec3>,
    /// The region of a point as known from its leaf.
    pub known: Vec<Option<u16>>,
    /// Four points per tet, in any orientation.
    pub tets: Vec<[u32; 4]>,
    /// Whether leaves of different sizes may meet at boundaries.
    pub has_unequal_leaves_at_boundaries: bool,
}

impl LatticeMesh {
    pub(super) fn new(tree: &Octree, part: &ProgressScope) -> Result<LatticeMesh> {
        let mut index: FxHashMap<u64, u32> = FxHashMap::default();
        index.reserve(tree.leaves.len() * 5 / 2);
        let mut points: Vec<Lattice> = Vec::new();
        let mut known: Vec<Option<u16>> = Vec::new();
        let mut own: Vec<[u32; 9]> = Vec::with_capacity(tree.leaves.len());
        for leaf in &tree.leaves {
            own.push([0, 1, 2, 3, 4, 5, 6, 7, 8].map(|n| {
                let point = point_of(leaf, n);
                let next = points.len() as u32;
                let found = *index.entry(key(point)).or_insert(next);
                if found == next {
                    points.push(point);
                    known.push(leaf.region);
                } else if known[found as usize].is_none() {
                    known[found as usize] = leaf.region;
                }
                found
            }));
        }
        if points.len() > u32::MAX as usize / 4 {
            return Err(Error::Input(
                "mesh exceeds the range of 32-bit node indices; increase the edge length".into(),
            ));
        }
        let between = LeafPair {
            tree,
            points: &points,
            own: &own,
            index: &index,
        };
        part.check_cancelled()?;
        let tets = parallel::collect(tree.leaves.len(), |range, tets| {
            if !part.should_continue() {
                return;
            }
            for l in range {
                between.tets_of(l as u32, tets);
            }
        });
        part.check_cancelled()?;
        let positions = points.iter().map(|p| tree.position(*p)).collect();
        Ok(LatticeMesh {
            points,
            positions,
            known,
            tets,
            has_unequal_leaves_at_boundaries: tree.follows_field,
        })
    }

    /// Whether the edge between two neighbours runs along an axis.
    pub(super) fn is_long(&self, a: u32, b: u32) -> bool {
        let (a, b) = (self.points[a as usize], self.points[b as usize]);
        (0..3).filter(|i| a[*i] != b[*i]).count() == 1
    }
}

/// Returns corner `n` of a leaf for n < 8, the centre for 8.
fn point_of(leaf: &Leaf, n: u32) -> Lattice {
    let side = side(leaf.level);
    match n {
        8 => leaf.corner.map(|c| c + side / 2),
        _ => [0, 1, 2].map(|axis| leaf.corner[axis] + (n >> axis & 1) * side),
    }
}

/// Data for the tets between leaves.
struct LeafPair<'a> {
    tree: &'a Octree,
    points: &'a [Lattice],
    own: &'a [[u32; 9]],
    index: &'a FxHashMap<u64, u32>,
}

impl LeafPair<'_> {
    /// Adds the tets between leaf `l` and its neighbours: those of equal size on the upper sides,
    /// and those of twice the size on all sides.
    fn tets_of(&self, l: u32, tets: &mut Vec<[u32; 4]>) {
        let leaf = self.tree.leaves[l as usize];
        let own = self.own[l as usize];
        let size = side(leaf.level);
        for axis in 0..3 {
            for upper in [true, false] {
                let mut beside = leaf.corner;
                beside[axis] = match upper {
                    true => beside[axis] + size,
                    false => match beside[axis].checked_sub(size) {
                        Some(lower) => lower,
                        None => continue,
                    },
                };
                let face = FACE_CORNERS.map(|[u, v]| {
                    let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
                    own[(u32::from(upper) << axis | u << second | v << third) as usize]
                });
                if let Some(other) = self.tree.find(beside, leaf.level) {
                    if upper {
                        self.add_equal_leaf_tets(
                            &leaf,
                            face,
                            [own[8], self.own[other as usize][8]],
                            tets,
                        );
                    }
                    continue;
                }
                let holder = beside.map(|c| c / (2 * size) * (2 * size));
                if let Some(other) = self.tree.find(holder, leaf.level + 1) {
                    let centres = [own[8], self.own[other as usize][8]];
                    // The centre of the large face is not a corner of the large leaf.
                    let middle = FACE_CORNERS.iter().position(|[u, v]| {
                        let steps = [(axis + 1) % 3, (axis + 2) % 3].into_iter().zip([u, v]);
                        steps
                            .into_iter()
                            .all(|(a, s)| (leaf.corner[a] + s * size) % (2 * size) == size)
                    });
                    let m = middle.unwrap_or(0);
                    let at = |n: usize| face[(m + n) % 4];
                    for centre in centres {
                        tets.push([at(0), at(1), at(2), centre]);
                        tets.push([at(0), at(2), at(3), centre]);
                    }
                }
            }
        }
    }

    /// Adds the tets around the line between the centres of two equal leaves.
    fn add_equal_leaf_tets(
        &self,
        leaf: &Leaf,
        face: [u32; 4],
        [c, d]: [u32; 2],
        tets: &mut Vec<[u32; 4]>,
    ) {
        for n in 0..4 {
            let (a, b) = (face[n], face[(n + 1) % 4]);
            let middle = match leaf.level {
                0 => None,
                _ => self.middle(a, b),
            };
            match middle {
                Some(m) => tets.extend([[c, d, a, m], [c, d, m, b]]),
                None => tets.push([c, d, a, b]),
            }
        }
    }

    /// Returns the midpoint between two corners of a leaf, if it is a lattice point.
    fn middle(&self, a: u32, b: u32) -> Option<u32> {
        let (a, b) = (self.points[a as usize], self.points[b as usize]);
        let middle = [0, 1, 2].map(|axis| (a[axis] + b[axis]) / 2);
        self.index.get(&key(middle)).copied()
    }
}
