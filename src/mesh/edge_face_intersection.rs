//! Intersections of edges with faces.

use super::bvh::{Bvh, bounds_union};
use crate::parallel;
use glam::DVec3;

/// An intersection of an edge with a face, by their numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeFaceIntersection {
    pub edge: usize,
    pub face: usize,
    /// Intersection point as barycentric weights of the corners of the face.
    pub weights: [f64; 3],
    /// The end of the edge that is behind the face.
    pub inner_end: usize,
}

/// Intersects an edge with a face: returns the barycentric weights of the face's corners at the
/// intersection and the end of the edge behind the face. A touching edge does not count.
pub(crate) fn intersect_edge_face(
    [p, q]: [DVec3; 2],
    [a, b, c]: [DVec3; 3],
) -> Option<([f64; 3], usize)> {
    let side = |x: DVec3| (b - a).cross(c - a).dot(x - a);
    let sides = [side(p), side(q)];
    if sides[0] * sides[1] >= 0.0 {
        return None;
    }
    let turn = |u: DVec3, v: DVec3| (u - p).cross(v - p).dot(q - p);
    let turns = [turn(b, c), turn(c, a), turn(a, b)];
    let all: f64 = turns.iter().sum();
    let within = turns.iter().all(|t| *t > 0.0) || turns.iter().all(|t| *t < 0.0);
    within.then(|| (turns.map(|t| t / all), usize::from(sides[1] < 0.0)))
}

/// Returns all intersections of edges with faces that share no node with them, for nodes at the
/// positions `at`. `tree` is built over the faces and is refitted.
pub(crate) fn edge_face_intersections(
    (count, edge): (usize, impl Fn(usize) -> [u32; 2] + Sync),
    face: impl Fn(usize) -> [u32; 3] + Sync,
    tree: &mut Bvh,
    at: impl Fn(u32) -> DVec3 + Sync,
) -> Vec<EdgeFaceIntersection> {
    let boxed = |nodes: &[u32]| {
        let boxes = nodes.iter().map(|v| [at(*v); 2]);
        boxes.reduce(bounds_union).unwrap_or_default()
    };
    tree.refit(|k| boxed(&face(k)));
    let tree = &*tree;
    parallel::collect(count, |range, found| {
        for k in range {
            let own = edge(k);
            tree.for_each_overlapping(&boxed(&own), |f| {
                let nodes = face(f as usize);
                if own.iter().any(|v| nodes.contains(v)) {
                    return;
                }
                let through = intersect_edge_face(own.map(&at), nodes.map(&at));
                found.extend(through.map(|(weights, behind)| EdgeFaceIntersection {
                    edge: k,
                    face: f as usize,
                    weights,
                    inner_end: behind,
                }));
            });
        }
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn goes(edge: [DVec3; 2], face: [DVec3; 3]) -> bool {
        intersect_edge_face(edge, face).is_some()
    }

    #[test]
    fn edge_face_intersection_detects_crossing_and_miss() {
        let face = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let at = |x: f64, y: f64, z: [f64; 2]| z.map(|z| DVec3::new(x, y, z));
        assert!(goes(at(0.2, 0.2, [-1.0, 1.0]), face));
        assert!(goes(at(0.2, 0.2, [1.0, -1.0]), face));
        assert!(!goes(at(0.8, 0.8, [-1.0, 1.0]), face));
        assert!(!goes(at(0.2, 0.2, [0.1, 1.0]), face));
        let (weights, behind) = intersect_edge_face(at(0.2, 0.3, [1.0, -1.0]), face).unwrap();
        let expected = [0.5, 0.2, 0.3];
        assert!(
            weights
                .iter()
                .zip(expected)
                .all(|(w, e)| (w - e).abs() < 1e-12)
        );
        assert_eq!(behind, 1);
    }
}
