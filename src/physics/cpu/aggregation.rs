//! Node ordering by recursive bisection into compact aggregates, so that neighbours in space are
//! close in memory.
//!
//! Each bisection cuts across the longest side. A Morton curve is nearly as good for the caches,
//! but it jumps, and aggregates split by a jump are poor for a coarse space. Aggregates of only
//! bone or only muscle were tried: they take three times the iterations of mixed ones.

use glam::DVec3;

/// A node order, divided into groups.
#[derive(Clone, Debug, PartialEq)]
pub struct Aggregates {
    /// Index of the k-th node, for every k.
    pub order: Vec<u32>,
    /// Start of each group, and the number of nodes.
    pub group_starts: Vec<usize>,
}

impl Aggregates {
    /// Orders the nodes at `points` in groups of at most `most`; deterministic.
    pub fn new(points: &[DVec3], most: usize) -> Aggregates {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut group_starts = vec![0];
        bisect(points, &mut order, most.max(1), &mut group_starts);
        Aggregates {
            order,
            group_starts,
        }
    }
}

fn bisect(points: &[DVec3], nodes: &mut [u32], most: usize, starts: &mut Vec<usize>) {
    if nodes.len() <= most {
        bisect_within(points, nodes);
        starts.push(starts.last().copied().unwrap_or(0) + nodes.len());
        return;
    }
    let groups = nodes.len().div_ceil(most);
    let half = nodes.len() * (groups / 2) / groups;
    let (left, right) = median_split(points, nodes, half);
    bisect(points, left, most, starts);
    bisect(points, right, most, starts);
}

fn bisect_within(points: &[DVec3], nodes: &mut [u32]) {
    if nodes.len() > 2 {
        let (left, right) = median_split(points, nodes, nodes.len() / 2);
        bisect_within(points, left);
        bisect_within(points, right);
    }
}

/// Splits the nodes by a plane across the longest side of their bounds: `half` on one side, and the
/// rest.
fn median_split<'a>(
    points: &[DVec3],
    nodes: &'a mut [u32],
    half: usize,
) -> (&'a mut [u32], &'a mut [u32]) {
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = nodes.iter().fold(start, |(low, high), v| {
        let p = points[*v as usize];
        (low.min(p), high.max(p))
    });
    let axis = (high - low).max_position();
    // Ties are broken by index, so that the order does not depend on the selection algorithm.
    nodes.select_nth_unstable_by(half, |a, b| {
        let (x, y) = (points[*a as usize][axis], points[*b as usize][axis]);
        x.total_cmp(&y).then(a.cmp(b))
    });
    nodes.split_at_mut(half)
}
