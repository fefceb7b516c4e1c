//! Signed distance fields of closed surfaces, sampled on a regular grid.

use super::SurfaceDistance;
use crate::Result;
use crate::mesh::TriMesh;
use crate::mesher::ClosedSurface;
use crate::parallel;
use glam::{DMat3, DVec3};

/// Grid points along the longest edge of the surface's bounds.
const GRID_POINTS: f64 = 64.0;

/// Layers of grid points around these bounds.
const PADDING_POINTS: f64 = 4.0;

/// Signed distances sampled on a grid and interpolated by quadratic B-splines, so that the gradient
/// is continuous. Edges and corners are rounded by about one spacing, 1/64 of the longest extent.
#[derive(Clone, Debug)]
pub struct DistanceField {
    /// The first grid point.
    low: DVec3,
    spacing: f64,
    counts: [usize; 3],
    values: std::sync::Arc<Vec<f64>>,
    /// Length of one unit of `values`.
    value_scale: f64,
    size: f64,
    radius: f64,
    /// The surface, in unscaled coordinates.
    surface: std::sync::Arc<TriMesh>,
}

impl DistanceField {
    /// Samples the signed distance of `surface`, in its own coordinates.
    ///
    /// # Errors
    /// [`Error::Mesh`](crate::Error::Mesh) if the surface is not closed.
    pub fn new(surface: &TriMesh) -> Result<DistanceField> {
        let closed = ClosedSurface::new(surface)?;
        let (low, high) = closed.bounds();
        let spacing = (high - low).max_element() / GRID_POINTS;
        let low = low - PADDING_POINTS * spacing;
        let counts = ((high - low) / spacing + PADDING_POINTS).ceil();
        let counts = counts.to_array().map(|n| n as usize + 1);
        let [nx, ny, nz] = counts;
        let values = parallel::map(nx * ny * nz, |i| {
            let at = [i % nx, i / nx % ny, i / (nx * ny)].map(|k| k as f64);
            -closed.signed_distance(low + spacing * DVec3::from(at))
        });
        let deepest = values.iter().fold(0.0f64, |a, b| a.min(*b));
        let far = surface.vertices.iter().map(|p| p.length());
        Ok(DistanceField {
            low,
            spacing,
            counts,
            value_scale: 1.0,
            size: -deepest,
            radius: far.fold(0.0, f64::max),
            surface: std::sync::Arc::new(surface.clone()),
            values: std::sync::Arc::new(values),
        })
    }

    /// Returns the field scaled by the factor `by`.
    #[must_use]
    pub fn with_scale(&self, by: f64) -> DistanceField {
        DistanceField {
            low: by * self.low,
            spacing: by * self.spacing,
            counts: self.counts,
            values: self.values.clone(),
            value_scale: by * self.value_scale,
            size: by * self.size,
            radius: by * self.radius,
            surface: self.surface.clone(),
        }
    }

    /// Distance between neighbouring grid points.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The scaled vertices and the triangles of the surface.
    pub fn surface(&self) -> (impl Iterator<Item = DVec3>, &[[u32; 3]]) {
        let vertices = self.surface.vertices.iter();
        (
            vertices.map(|p| self.value_scale * *p),
            &self.surface.triangles,
        )
    }

    /// Returns the first grid point, the number of points along each axis, the values, and the
    /// length of one unit of the values.
    pub(in crate::physics) fn grid(&self) -> (DVec3, [usize; 3], &[f64], f64) {
        (self.low, self.counts, &self.values, self.value_scale)
    }

    /// The largest depth of a point inside the surface.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// The largest distance of the surface from the origin.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Clamps `p` to the region with a complete interpolation stencil. Returns the clamped point in
    /// grid coordinates (spacings from the first point) and the offset of `p` from it.
    fn clamp_to_grid(&self, p: DVec3) -> (DVec3, DVec3) {
        let last = DVec3::from(self.counts.map(|n| n as f64 - 2.5));
        let high = self.low + self.spacing * last;
        let near = p.clamp(self.low + 1.5 * self.spacing, high);
        ((near - self.low) / self.spacing, p - near)
    }

    /// Returns the signed distance of `p`. Outside the grid it is the distance from the grid plus a
    /// margin, which underestimates the distance from the surface.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.evaluate(p).distance
    }

    /// Returns the signed distance of `p` with its gradient and second derivatives.
    pub(crate) fn evaluate(&self, p: DVec3) -> SurfaceDistance {
        let (at, beyond) = self.clamp_to_grid(p);
        let first = (at - 0.5).floor();
        let weights: [[[f64; 3]; 3]; 3] = std::array::from_fn(|k| quadratic(at[k] - first[k]));
        let start = first.to_array().map(|k| k as usize);
        let [nx, ny, _] = self.counts;
        let mut sums = [0.0; 10];
        for z in 0..3 {
            for y in 0..3 {
                let row = (start[2] + z) * ny + start[1] + y;
                for x in 0..3 {
                    let value = self.values[row * nx + start[0] + x];
                    let w = |dx: usize, dy: usize, dz: usize| {
                        weights[0][dx][x] * weights[1][dy][y] * weights[2][dz][z] * value
                    };
                    let terms = [
                        w(0, 0, 0),
                        w(1, 0, 0),
                        w(0, 1, 0),
                        w(0, 0, 1),
                        w(2, 0, 0),
                        w(0, 2, 0),
                        w(0, 0, 2),
                        w(1, 1, 0),
                        w(1, 0, 1),
                        w(0, 1, 1),
                    ];
                    sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
                }
            }
        }
        let [value, x, y, z, xx, yy, zz, xy, xz, yz] = sums;
        // Values are lengths, the argument of the spline is in spacings.
        let (slope, bend) = (
            self.value_scale / self.spacing,
            self.value_scale / self.spacing.powi(2),
        );
        let touch = SurfaceDistance {
            distance: self.value_scale * value,
            normal: slope * DVec3::new(x, y, z),
            curvature: DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]) * bend,
        };
        let far = beyond.length();
        match far > 0.0 {
            false => touch,
            true => SurfaceDistance {
                distance: far + (PADDING_POINTS - 1.5) * self.spacing,
                normal: beyond / far,
                curvature: DMat3::ZERO,
            },
        }
    }
}

/// Quadratic B-spline weights of three points, with two derivatives; `t` from ½ to 1½ is measured
/// from the first point.
fn quadratic(t: f64) -> [[f64; 3]; 3] {
    let s = t - 1.0;
    [
        [
            0.5 * (0.5 - s) * (0.5 - s),
            0.75 - s * s,
            0.5 * (0.5 + s) * (0.5 + s),
        ],
        [s - 0.5, -2.0 * s, s + 0.5],
        [1.0, -2.0, 1.0],
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::mesh::Topology;

    /// The surface of a sphere of radius 1.
    fn sphere() -> TriMesh {
        let ball = generate::ball(1.0, 14).unwrap();
        let topology = Topology::new(&ball);
        let faces = topology.boundary.iter();
        TriMesh {
            triangles: faces.map(|f| topology.boundary_nodes(&ball, *f)).collect(),
            vertices: ball.nodes,
            ..TriMesh::default()
        }
    }

    #[test]
    fn ball_sdf_matches_exact_distance() {
        let field = DistanceField::new(&sphere()).unwrap();
        for p in [
            DVec3::new(1.05, 0.0, 0.0),
            DVec3::new(0.6, -0.6, 0.6),
            DVec3::new(0.0, 0.3, -0.5),
        ] {
            let touch = field.evaluate(p);
            let exact = p.length() - 1.0;
            // The faces lie inside the sphere, and the spline rounds by the square of a spacing.
            let near = 0.02 * (1.0 + exact.abs());
            assert!((touch.distance - exact).abs() < near, "{p}: {touch:?}");
            assert!(touch.normal.dot(p.normalize()) > 0.98, "{p}: {touch:?}");
        }
        let beyond = DVec3::new(3.0, 2.0, -1.0);
        let (least, exact) = (field.distance(beyond), beyond.length() - 1.0);
        assert!(least < exact && least > 0.7 * exact, "{least} {exact}");
        assert!((field.size() - 1.0).abs() < 0.05);
        assert!((field.radius() - 1.0).abs() < 1e-9);
        let far = field.with_scale(3.0).evaluate(DVec3::new(3.3, 0.3, -0.6));
        let near = field.evaluate(DVec3::new(1.1, 0.1, -0.2));
        assert!((far.distance - 3.0 * near.distance).abs() < 1e-12);
        assert!(far.normal.distance(near.normal) < 1e-12);
    }

    #[test]
    fn sdf_gradient_is_continuous_and_matches_finite_differences() {
        let field = DistanceField::new(&sphere()).unwrap();
        let h = 1e-7;
        for i in 0..400 {
            let t = f64::from(i);
            let p = 0.9 * DVec3::new((0.7 * t).sin(), (1.3 * t).cos(), (0.4 * t).sin());
            let touch = field.evaluate(p);
            for (k, axis) in DVec3::AXES.into_iter().enumerate() {
                let (a, b) = (field.evaluate(p - h * axis), field.evaluate(p + h * axis));
                let by_value = (b.distance - a.distance) / (2.0 * h);
                assert!((by_value - touch.normal[k]).abs() < 1e-5, "{p}");
                assert!(a.normal.distance(b.normal) < 1e-4, "{p}");
            }
        }
    }

    #[test]
    fn sdf_rejects_open_surface() {
        let mut open = sphere();
        let half = open.triangles.len() / 2;
        open.triangles.truncate(half);
        let error = DistanceField::new(&open).unwrap_err().to_string();
        assert!(error.contains("96 open edges"), "{error}");
    }
}
