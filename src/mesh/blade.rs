//! The surface swept by a blade, and which segments it separates.

use super::bounds;
use crate::{Error, Result};
use glam::DVec3;

/// Triangles with an area below this fraction of the squared extent of the blade are dropped.
const DEGENERATE_AREA_RATIO: f64 = 1e-12;

/// Points closer to the surface than this fraction of the extent of the blade count as in front of
/// it, so a point placed on the surface is on one side whatever the rounding.
const THICKNESS: f64 = 1e-9;

/// The surface swept by the edge of a blade, as triangles in file units.
#[derive(Clone, Debug, PartialEq)]
pub struct Blade {
    vertices: Vec<DVec3>,
    triangles: Vec<Triangle>,
    low: DVec3,
    high: DVec3,
}

#[derive(Clone, Debug, PartialEq)]
struct Triangle {
    vertices: [u32; 3],
    normal: DVec3,
    /// Smallest n · x of points in front.
    front: f64,
    low: DVec3,
    high: DVec3,
}

impl Blade {
    /// Builds the surface swept by the straight edge of a blade from its consecutive positions,
    /// each given by its two ends: a quad of two triangles between each two.
    ///
    /// # Errors
    /// An [`Error::Input`] for fewer than two positions, for non-finite coordinates, and for an
    /// edge that sweeps no area.
    pub fn from_sweep(edges: &[[DVec3; 2]]) -> Result<Blade> {
        let points: Vec<DVec3> = edges.iter().flatten().copied().collect();
        if let Some(bad) = points.iter().position(|p| !p.is_finite()) {
            return Err(Error::Input(format!(
                "end {} of the blade's edge at position {} must have finite coordinates, got {}",
                bad % 2,
                bad / 2,
                points[bad]
            )));
        }
        let (low, high) = bounds(&points);
        let extent = (high - low).max_element();
        let mut blade = Blade {
            triangles: Vec::new(),
            low: low - THICKNESS * extent,
            high: high + THICKNESS * extent,
            vertices: points,
        };
        for k in 1..edges.len() as u32 {
            let [a, b, c, d] = [2 * k - 2, 2 * k - 1, 2 * k + 1, 2 * k];
            blade.add([a, b, c], extent);
            blade.add([a, c, d], extent);
        }
        if blade.triangles.is_empty() {
            return Err(Error::Input(format!(
                "blade sweeps zero area: {} edge positions lie within {extent} of each other; give \
                at least two distinct positions",
                edges.len()
            )));
        }
        Ok(blade)
    }

    /// Returns the ends of the edge at each of its positions.
    pub(crate) fn edges(&self) -> impl Iterator<Item = [DVec3; 2]> + '_ {
        self.vertices.chunks_exact(2).map(|ends| [ends[0], ends[1]])
    }

    /// Builds the quad with these corners, in cyclic order; it may be twisted.
    ///
    /// # Errors
    /// As [`Blade::from_sweep`].
    pub fn from_quad([a, b, c, d]: [DVec3; 4]) -> Result<Blade> {
        Blade::from_sweep(&[[a, b], [d, c]])
    }

    fn add(&mut self, vertices: [u32; 3], extent: f64) {
        let corners = vertices.map(|v| self.vertices[v as usize]);
        let [a, b, c] = corners;
        let across = (b - a).cross(c - a);
        let area = across.length();
        // A vertex that has not moved leaves a degenerate triangle.
        if area.is_nan() || area <= DEGENERATE_AREA_RATIO * extent * extent {
            return;
        }
        let normal = across / area;
        let (low, high) = bounds(&corners);
        self.triangles.push(Triangle {
            vertices,
            normal,
            front: normal.dot(a - self.low) - THICKNESS * extent,
            low: low - 2.0 * THICKNESS * extent,
            high: high + 2.0 * THICKNESS * extent,
        });
    }

    /// Returns the corners of its triangles.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles
            .iter()
            .map(|t| t.vertices.map(|v| self.vertices[v as usize]))
    }

    /// Returns the lower and upper corner of the bounding box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.low, self.high)
    }

    /// Whether the segment from `a` to `b` crosses the blade, i.e. intersects it an odd number of
    /// times. The result is symmetric in `a` and `b`, and a polyline crosses a blade larger than
    /// itself with the parity given by its end points.
    pub fn separates(&self, a: DVec3, b: DVec3) -> bool {
        let intersected = self
            .triangles
            .iter()
            .filter(|t| self.intersects_segment(t, a, b));
        intersected.count() % 2 == 1
    }

    fn intersects_segment(&self, triangle: &Triangle, a: DVec3, b: DVec3) -> bool {
        let apart = a.min(b).cmpgt(triangle.high) | a.max(b).cmplt(triangle.low);
        if apart.any() {
            return false;
        }
        let side = |p: DVec3| triangle.normal.dot(p - self.low) >= triangle.front;
        let (from_front, to_front) = (side(a), side(b));
        // NaN is on neither side.
        if from_front == to_front || !(a.is_finite() && b.is_finite()) {
            return false;
        }
        // The segment is always oriented from the front, so both directions give the same result.
        let (front, back) = if from_front { (a, b) } else { (b, a) };
        let along = back - front;
        let [u, v, w] = triangle.vertices;
        // Bitwise identical up to the sign for both directions of an edge: of two triangles that
        // share an edge, exactly one is hit.
        let inside = |p: u32, q: u32| {
            let turn = |p: u32, q: u32| {
                let [x, y] = [p, q].map(|v| self.vertices[v as usize] - front);
                along.dot(y.cross(x))
            };
            let turned = turn(p, q);
            turned > 0.0 || (turned == 0.0 && p < q)
        };
        inside(u, v) && inside(v, w) && inside(w, u)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn square() -> Blade {
        Blade::from_quad([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]).unwrap()
    }

    #[test]
    fn blade_intersects_only_segments_through_it() {
        let blade = square();
        assert_eq!(blade.triangles().count(), 2);
        for (x, y, hit) in [
            (0.5, 0.25, true),
            (0.25, 0.5, true),
            // On the edge shared by the two triangles: counted exactly once.
            (0.5, 0.5, true),
            (0.125, 0.125, true),
            (1.5, 0.5, false),
            (0.5, -0.01, false),
        ] {
            let (a, b) = (DVec3::new(x, y, 0.3), DVec3::new(x, y, -0.2));
            assert_eq!(blade.separates(a, b), hit, "{x} {y}");
            assert_eq!(blade.separates(b, a), hit, "{x} {y}");
            assert!(!blade.separates(a, DVec3::new(x, y, 0.1)));
            // A point on the blade counts on one side or the other.
            let on = DVec3::new(x, y, 0.0);
            assert_eq!(blade.separates(a, on) ^ blade.separates(on, b), hit);
            assert!(!blade.separates(a, DVec3::splat(f64::NAN)));
        }
    }

    #[test]
    fn folded_blade_crossed_twice_does_not_separate() {
        let edge = |x: f64, z: f64| [DVec3::new(x, 0.0, z), DVec3::new(x, 1.0, z)];
        let roof = Blade::from_sweep(&[edge(0.0, 0.0), edge(1.0, 1.0), edge(2.0, 0.0)]).unwrap();
        let at = |x: f64, z: f64| DVec3::new(x, 0.4, z);
        assert!(roof.separates(at(0.2, 0.5), at(1.0, 0.5)));
        assert!(!roof.separates(at(0.2, 0.5), at(1.8, 0.5)));
    }

    #[test]
    fn blade_rejects_zero_area_and_nan() {
        let edge = [DVec3::ZERO, DVec3::X];
        for edges in [
            vec![],
            vec![edge],
            vec![edge; 3],
            vec![edge, [DVec3::X, 2.0 * DVec3::X]],
        ] {
            let error = Blade::from_sweep(&edges).unwrap_err().to_string();
            assert!(error.contains("zero area"), "{error}");
        }
        let error = Blade::from_sweep(&[edge, [DVec3::Y, DVec3::NAN]])
            .unwrap_err()
            .to_string();
        assert!(error.contains("position 1"), "{error}");
        // One end may be fixed.
        assert!(Blade::from_sweep(&[edge, [DVec3::ZERO, DVec3::Y]]).is_ok());
    }
}
