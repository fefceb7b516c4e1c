//! Closest intersection of a ray with a list of triangles, in float64; reference of
//! `shaders/render/pick.wgsl`.

use crate::render::Ray;
use glam::DVec3;

/// Intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle.
    pub triangle: usize,
    /// Barycentric coordinates; their sum is 1.
    pub weights: [f64; 3],
    /// Distance from the ray origin (the direction has unit length).
    pub distance: f64,
}

impl Hit {
    /// Returns the closest intersection of `ray` with `triangles`, two-sided, by brute force; `None` if
    /// it misses all.
    pub fn closest(vertices: &[DVec3], triangles: &[[u32; 3]], ray: Ray) -> Option<Hit> {
        let hits = triangles.iter().enumerate().filter_map(|(i, corners)| {
            let corners = corners.map(|v| vertices[v as usize] - ray.origin);
            let (weights, distance) = intersect_ray(corners, ray.direction)?;
            Some(Hit {
                triangle: i,
                weights,
                distance,
            })
        });
        hits.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}

/// Returns barycentric coordinates and distance of the intersection of a ray from the origin with a
/// triangle: the volumes spanned by each edge and the direction must have equal signs.
fn intersect_ray([a, b, c]: [DVec3; 3], direction: DVec3) -> Option<([f64; 3], f64)> {
    let volumes = [(b, c), (c, a), (a, b)].map(|(p, q)| p.cross(q).dot(direction));
    let sum: f64 = volumes.iter().sum();
    let within = volumes.iter().all(|v| v * sum >= 0.0) && sum != 0.0;
    let [u, v, w] = volumes.map(|v| v / sum);
    let distance = (u * a + v * b + w * c).dot(direction);
    (within && distance >= 0.0).then_some(([u, v, w], distance))
}
