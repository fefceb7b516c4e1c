//! The first of a list of triangles that a ray meets, in float64: the twin of
//! `shaders/render/pick.wgsl`.

use crate::render::Ray;
use glam::DVec3;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The triangle's place in the list.
    pub triangle: usize,
    /// Weights of its corners; their sum is 1.
    pub weights: [f64; 3],
    /// Distance from the origin of the ray, which has a direction of length 1.
    pub distance: f64,
}

/// What `ray` meets first of `triangles`, from either side, by trying each; none where it misses.
pub fn closest_hit(vertices: &[DVec3], triangles: &[[u32; 3]], ray: Ray) -> Option<Hit> {
    let hits = triangles.iter().enumerate().filter_map(|(i, corners)| {
        let corners = corners.map(|v| vertices[v as usize] - ray.origin);
        let (weights, distance) = meet(corners, ray.direction)?;
        Some(Hit {
            triangle: i,
            weights,
            distance,
        })
    });
    hits.min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// Weights and distance where the ray from 0 meets the triangle: the volumes that each edge spans
/// with the direction have one sign.
fn meet([a, b, c]: [DVec3; 3], direction: DVec3) -> Option<([f64; 3], f64)> {
    let volumes = [(b, c), (c, a), (a, b)].map(|(p, q)| p.cross(q).dot(direction));
    let sum: f64 = volumes.iter().sum();
    let within = volumes.iter().all(|v| v * sum >= 0.0) && sum != 0.0;
    let [u, v, w] = volumes.map(|v| v / sum);
    let distance = (u * a + v * b + w * c).dot(direction);
    (within && distance >= 0.0).then_some(([u, v, w], distance))
}
