//! A bounding volume hierarchy over primitives of a boundary, built once and refitted as they move.

use super::order_of;
use glam::DVec3;

/// Low and high corners.
pub(crate) type Bounds = [DVec3; 2];

/// Primitives per leaf.
const LEAF: usize = 4;

/// A complete binary tree over primitives in Morton order.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    /// The primitives, in order.
    order: Vec<u32>,
    /// Bounding boxes: the root is box 0, the children of k are 2k + 1 and 2k + 2.
    boxes: Vec<Bounds>,
    /// Number of inner boxes.
    inner: usize,
    /// The bounding box of each primitive.
    parts: Vec<Bounds>,
}

/// The empty box.
const EMPTY: Bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];

/// Returns the smallest box around two boxes.
pub(crate) fn bounds_union([a, b]: Bounds, [c, d]: Bounds) -> Bounds {
    [a.min(c), b.max(d)]
}

/// Whether two boxes overlap.
pub(crate) fn bounds_overlap([a, b]: &Bounds, [c, d]: &Bounds) -> bool {
    a.cmple(*d).all() && c.cmple(*b).all()
}

impl Bvh {
    /// Builds the tree over `count` primitives with these centres.
    pub fn new(count: usize, middle: impl Fn(usize) -> DVec3 + Sync) -> Bvh {
        let all = (0..count).fold(EMPTY, |all, k| bounds_union(all, [middle(k); 2]));
        let leaves = count.div_ceil(LEAF).max(1).next_power_of_two();
        Bvh {
            order: order_of(count, (all[0], all[1]), middle),
            boxes: vec![EMPTY; 2 * leaves - 1],
            inner: leaves - 1,
            parts: vec![EMPTY; count],
        }
    }

    /// Refits it to the current bounding boxes of the primitives.
    pub fn refit(&mut self, of: impl Fn(usize) -> Bounds) {
        for (k, own) in self.parts.iter_mut().enumerate() {
            *own = of(k);
        }
        self.boxes.fill(EMPTY);
        for (n, k) in self.order.iter().enumerate() {
            let leaf = &mut self.boxes[self.inner + n / LEAF];
            *leaf = bounds_union(*leaf, self.parts[*k as usize]);
        }
        for k in (0..self.inner).rev() {
            self.boxes[k] = bounds_union(self.boxes[2 * k + 1], self.boxes[2 * k + 2]);
        }
    }

    /// Visits the primitives whose boxes overlap `wanted`, in a deterministic order.
    pub fn for_each_overlapping(&self, wanted: &Bounds, mut each: impl FnMut(u32)) {
        let mut stack = vec![0usize];
        while let Some(k) = stack.pop() {
            if !bounds_overlap(&self.boxes[k], wanted) {
                continue;
            }
            if k < self.inner {
                stack.extend([2 * k + 2, 2 * k + 1]);
                continue;
            }
            let first = (k - self.inner) * LEAF;
            let last = (first + LEAF).min(self.order.len());
            for part in &self.order[first.min(last)..last] {
                if bounds_overlap(&self.parts[*part as usize], wanted) {
                    each(*part);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::pseudo_random_points;

    #[test]
    fn bvh_visits_exactly_the_overlapping_boxes() {
        for count in [0, 1, 3, 4, 5, 63, 200] {
            let middles = pseudo_random_points(count, 1);
            let mut hierarchy = Bvh::new(count, |k| middles[k]);
            for seed in 2..6 {
                let corners = pseudo_random_points(2 * count + 2, seed);
                let boxed = |k: usize, size: f64| {
                    let (p, size) = (corners[2 * k], size * corners[2 * k + 1].abs());
                    [p - size, p + size]
                };
                hierarchy.refit(|k| boxed(k, 0.2));
                let wanted = boxed(count, 0.5);
                let mut found = Vec::new();
                hierarchy.for_each_overlapping(&wanted, |k| found.push(k as usize));
                found.sort_unstable();
                let all = (0..count).filter(|k| bounds_overlap(&boxed(*k, 0.2), &wanted));
                assert_eq!(found, all.collect::<Vec<_>>());
            }
        }
    }
}
