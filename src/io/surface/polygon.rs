//! Triangulation of planar polygons, convex and concave.

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// Cuts polygons into triangles; it keeps its buffers.
pub(super) struct PolygonCutter {
    ears: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    found: Vec<u32>,
}

impl PolygonCutter {
    pub fn new() -> PolygonCutter {
        PolygonCutter {
            ears: Earcut::new(),
            flat: Vec::new(),
            found: Vec::new(),
        }
    }

    /// Returns triangles of the polygon with these corners, as numbers of its corners: a fan of a
    /// convex one, ears of a concave one. Every corner is used, so that neighbouring polygons stay
    /// joined.
    pub fn triangles(&mut self, corners: &[DVec3]) -> Vec<[usize; 3]> {
        let fan = || {
            (2..corners.len())
                .map(|n| [0, n - 1, n])
                .collect::<Vec<_>>()
        };
        if corners.len() < 4 || !self.project(corners) || self.is_convex() {
            return fan();
        }
        self.found.clear();
        self.ears.earcut_slice(&self.flat, &[], &mut self.found);
        let place = |n: usize| DVec2::from(self.flat[n]);
        let mut triangles: Vec<[usize; 3]> = self
            .found
            .as_chunks::<3>()
            .0
            .iter()
            .map(|t| t.map(|n| n as usize))
            .collect();
        if triangles.is_empty() {
            return fan();
        }
        for triangle in &mut triangles {
            let [a, b, c] = triangle.map(place);
            if (b - a).perp_dot(c - a) < 0.0 {
                triangle.swap(1, 2);
            }
        }
        restore_straight_corners(&mut triangles, corners.len());
        triangles
    }

    /// Projects the polygon along its mean normal, so that it is counter-clockwise; false if it has
    /// no area.
    fn project(&mut self, corners: &[DVec3]) -> bool {
        let origin = corners[0];
        let next = corners.iter().cycle().skip(1);
        let normal: DVec3 = corners
            .iter()
            .zip(next)
            .map(|(a, b)| (*a - origin).cross(*b - origin))
            .sum();
        let Some(normal) = normal.try_normalize() else {
            return false;
        };
        let (u, v) = normal.any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(corners.iter().map(|p| {
            let p = *p - origin;
            [p.dot(u), p.dot(v)]
        }));
        true
    }

    /// Whether no corner of the projected polygon turns right by more than rounding.
    fn is_convex(&self) -> bool {
        const ROUNDING: f64 = 1e-9;
        let count = self.flat.len();
        let place = |n: usize| DVec2::from(self.flat[n % count]);
        (0..count).all(|n| {
            let (before, after) = (place(n + 1) - place(n), place(n + 2) - place(n + 1));
            before.perp_dot(after) >= -ROUNDING * before.length() * after.length()
        })
    }
}

/// Adds the corners that cutting ears left out because they lie on a straight edge: the triangle at
/// that edge is divided.
fn restore_straight_corners(triangles: &mut Vec<[usize; 3]>, count: usize) {
    let mut used = vec![false; count];
    for corner in triangles.iter().flatten() {
        used[*corner] = true;
    }
    for n in 0..count {
        if used[n] {
            continue;
        }
        let other = |step: &dyn Fn(usize) -> usize| {
            let mut at = step(n);
            while !used[at] && at != n {
                at = step(at);
            }
            at
        };
        let before = other(&|n| (n + count - 1) % count);
        let after = other(&|n| (n + 1) % count);
        let edge = triangles.iter().enumerate().find_map(|(t, triangle)| {
            let side =
                (0..3).find(|i| triangle[*i] == before && triangle[(*i + 1) % 3] == after)?;
            Some((t, triangle[(side + 2) % 3]))
        });
        if let Some((t, apex)) = edge {
            triangles[t] = [before, n, apex];
            triangles.push([n, after, apex]);
            used[n] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3], triangles: &[[usize; 3]]) -> (f64, f64) {
        let vectors = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|n| corners[n]);
            0.5 * (b - a).cross(c - a)
        });
        let sum: DVec3 = vectors.clone().sum();
        (sum.length(), vectors.map(DVec3::length).sum())
    }

    #[test]
    fn concave_polygons_are_covered_once_with_every_corner() {
        // A U with a corner on a straight edge, in an oblique plane, from each first corner.
        let flat = [
            (0.0, 0.0),
            (1.5, 0.0),
            (3.0, 0.0),
            (3.0, 2.0),
            (2.0, 2.0),
            (2.0, 1.0),
            (1.0, 1.0),
            (1.0, 2.0),
            (0.0, 2.0),
        ];
        let (u, v) = DVec3::new(1.0, 2.0, -1.5)
            .normalize()
            .any_orthonormal_pair();
        for first in 0..flat.len() {
            let mut corners = flat
                .map(|(x, y)| x * u + y * v + DVec3::splat(3.0))
                .to_vec();
            corners.rotate_left(first);
            let triangles = PolygonCutter::new().triangles(&corners);
            assert_eq!(triangles.len(), corners.len() - 2, "{first}");
            let (sum, total) = area(&corners, &triangles);
            assert!(
                (sum - 5.0).abs() < 1e-12 && (total - 5.0).abs() < 1e-12,
                "{first}"
            );
        }
    }
}
