//! Distances to triangles, and the depth of nodes below the boundary: a field for meshes that have
//! none.

use super::{BoundaryFace, Field, Location, TetMesh, Topology};
use crate::parallel;
use glam::DVec3;

/// Name of the field of [`depth_field`].
pub(crate) const DEPTH: &str = "depth";

/// Triangles in a leaf of the tree.
const LEAF: usize = 4;

/// Computes the node field "depth": the distance of each node to the nearest point of the boundary,
/// in the units of the mesh; exactly 0 on the boundary. Time O(n log n), in parallel.
pub fn depth_field(mesh: &TetMesh, topology: &Topology) -> Field {
    let mut on_boundary = vec![false; mesh.nodes.len()];
    let mut triangles: Vec<[DVec3; 3]> = Vec::with_capacity(topology.boundary.len());
    for &face in &topology.boundary {
        triangles.push(corners(mesh, topology, face));
        for v in topology.boundary_nodes(mesh, face) {
            on_boundary[v as usize] = true;
        }
    }
    let tree = TriangleBvh::new(triangles);
    let depth = parallel::map(mesh.nodes.len(), |v| match on_boundary[v] {
        true => 0.0,
        false => tree.distance(mesh.nodes[v]),
    });
    Field::scalar(DEPTH, Location::Node, depth)
}

fn corners(mesh: &TetMesh, topology: &Topology, face: BoundaryFace) -> [DVec3; 3] {
    topology
        .boundary_nodes(mesh, face)
        .map(|v| mesh.nodes[v as usize])
}

/// Returns the distance from `p` to the triangle `abc`, which may be degenerate.
///
/// Uses the Voronoi regions of the triangle, as in Ericson, *Real-Time Collision Detection*, 5.1.5.
pub fn point_triangle_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, normal) = (b - a, c - a, (b - a).cross(c - a));
    let inside = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) >= 0.0;
    let area = normal.length();
    // A triangle thinner than the rounding error has no plane: its edges give the distance.
    let flat = area <= 1e-12 * ab.length_squared().max(ac.length_squared());
    if !flat && inside(a, b) && inside(b, c) && inside(c, a) {
        return ((p - a).dot(normal) / area).abs();
    }
    let edges = [(a, b), (b, c), (c, a)];
    let distance = |(from, to): (DVec3, DVec3)| point_segment_distance(p, from, to);
    edges
        .map(distance)
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

fn point_segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = (p - a).dot(b - a) / (b - a).length_squared();
    // A segment of length zero gives NaN, which clamps to its start.
    let along = if along.is_nan() {
        0.0
    } else {
        along.clamp(0.0, 1.0)
    };
    p.distance(a.lerp(b, along))
}

/// Returns the barycentric weights of the point of the triangle `abc` closest to `p`.
///
/// Uses the Voronoi regions of the triangle, as in Ericson, *Real-Time Collision Detection*, 5.1.5.
pub(crate) fn closest_point_weights(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let all = va + vb + vc;
    // A degenerate triangle in none of the regions: any corner will do.
    if all > 0.0 {
        [va / all, vb / all, vc / all]
    } else {
        [1.0, 0.0, 0.0]
    }
}

/// A bounding volume hierarchy of axis-aligned boxes over triangles, split at the median.
#[derive(Debug)]
pub(crate) struct TriangleBvh {
    /// The triangles, in the order of the leaves.
    pub triangles: Vec<[DVec3; 3]>,
    /// The original number of each triangle.
    pub numbers: Vec<u32>,
    /// Box 0 is the root; the `right` of a leaf is 0.
    pub boxes: Vec<TreeBox>,
}

#[derive(Debug)]
pub(crate) struct TreeBox {
    pub low: DVec3,
    pub high: DVec3,
    /// Range of its triangles.
    pub range: (usize, usize),
    /// The second child; the first child is the next box in the list.
    pub right: usize,
}

impl TreeBox {
    fn distance_squared(&self, p: DVec3) -> f64 {
        p.distance_squared(p.clamp(self.low, self.high))
    }
}

impl TriangleBvh {
    pub fn new(triangles: Vec<[DVec3; 3]>) -> TriangleBvh {
        let mut boxes = Vec::new();
        let mut numbered: Vec<(u32, [DVec3; 3])> = (0..).zip(triangles).collect();
        let end = numbered.len();
        build(&mut numbered, (0, end), &mut boxes);
        let (numbers, triangles) = numbered.into_iter().unzip();
        TriangleBvh {
            triangles,
            numbers,
            boxes,
        }
    }

    /// Returns the distance from `p` to the nearest triangle; infinite if there is none.
    pub fn distance(&self, p: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        self.descend(p, |t| {
            nearest = nearest.min(point_triangle_distance(p, self.triangles[t]));
            nearest
        });
        nearest
    }

    /// Returns the number of the triangle nearest to `p` (the lowest among equals) and the
    /// barycentric weights of the closest point. `None` if there is no triangle.
    pub fn nearest(&self, p: DVec3) -> Option<(usize, [f64; 3])> {
        self.nearest_accepted(p, |_| true)
    }

    /// As [`TriangleBvh::nearest`], among the triangles whose numbers `accept` accepts.
    pub fn nearest_accepted(
        &self,
        p: DVec3,
        accept: impl Fn(usize) -> bool,
    ) -> Option<(usize, [f64; 3])> {
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        self.descend(p, |t| {
            let [a, b, c] = self.triangles[t];
            let w = closest_point_weights(p, [a, b, c]);
            let distance = p.distance(w[0] * a + w[1] * b + w[2] * c);
            let better = best.is_none_or(|(least, number, _)| {
                distance < least || (distance == least && self.numbers[t] < number)
            });
            if better && accept(self.numbers[t] as usize) {
                best = Some((distance, self.numbers[t], w));
            }
            best.map_or(f64::INFINITY, |b| b.0)
        });
        best.map(|(_, number, w)| (number as usize, w))
    }

    /// Visits the triangles that may be nearer to `p` than the smallest distance `visit` has
    /// returned.
    fn descend(&self, p: DVec3, mut visit: impl FnMut(usize) -> f64) {
        let mut nearest = f64::INFINITY;
        let mut stack = vec![(0, 0.0)];
        while let Some((index, at_least)) = stack.pop() {
            let Some(node) = self.boxes.get(index) else {
                continue;
            };
            if at_least >= nearest * nearest {
                continue;
            }
            if node.right == 0 {
                (node.range.0..node.range.1).for_each(|t| nearest = visit(t));
                continue;
            }
            let mut halves =
                [index + 1, node.right].map(|i| (i, self.boxes[i].distance_squared(p)));
            halves.sort_by(|a, b| b.1.total_cmp(&a.1));
            stack.extend(halves);
        }
    }
}

fn build(
    triangles: &mut [(u32, [DVec3; 3])],
    (start, end): (usize, usize),
    boxes: &mut Vec<TreeBox>,
) {
    let own = &mut triangles[start..end];
    let (low, high) = own
        .iter()
        .flat_map(|(_, corners)| corners)
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(*p), high.max(*p))
        });
    let index = boxes.len();
    boxes.push(TreeBox {
        low,
        high,
        range: (start, end),
        right: 0,
    });
    if end - start <= LEAF {
        return;
    }
    let axis = (high - low).max_position();
    let centre = |(_, t): &(u32, [DVec3; 3])| t[0][axis] + t[1][axis] + t[2][axis];
    let half = (end - start) / 2;
    own.select_nth_unstable_by(half, |a, b| centre(a).total_cmp(&centre(b)));
    build(triangles, (start, start + half), boxes);
    boxes[index].right = boxes.len();
    build(triangles, (start + half, end), boxes);
}
