//! The order in which the engine keeps the nodes: in groups that are compact lumps, neighbours in
//! space close in memory.
//!
//! By recursive bisection across the longest side. A Morton curve does nearly as well for the
//! caches, but it jumps, and lumps that a jump tears apart are poor aggregates of a coarse space.
//! Lumps of nothing but bone in muscle, or of nothing but muscle, were tried: they take three times
//! the iterations of lumps that have some of both.

use glam::DVec3;

/// Nodes in an order, and in groups.
#[derive(Clone, Debug, PartialEq)]
pub struct Aggregates {
    /// The node that comes k-th, for every k.
    pub order: Vec<u32>,
    /// Where each group begins, and the number of nodes.
    pub group_starts: Vec<usize>,
}

impl Aggregates {
    /// Nodes at `points` in groups of at most `most`. The same on every run.
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
    let (left, right) = halves(points, nodes, half);
    bisect(points, left, most, starts);
    bisect(points, right, most, starts);
}

fn bisect_within(points: &[DVec3], nodes: &mut [u32]) {
    if nodes.len() > 2 {
        let (left, right) = halves(points, nodes, nodes.len() / 2);
        bisect_within(points, left);
        bisect_within(points, right);
    }
}

/// The `half` nodes on one side of a plane across the longest side of their bounds, and the rest.
fn halves<'a>(
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
    // Ties go by number, for the order must not depend on how the selection is done.
    nodes.select_nth_unstable_by(half, |a, b| {
        let (x, y) = (points[*a as usize][axis], points[*b as usize][axis]);
        x.total_cmp(&y).then(a.cmp(b))
    });
    nodes.split_at_mut(half)
}
