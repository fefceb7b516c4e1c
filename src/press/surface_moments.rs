//! Area and moments of a surface as seen along an axis, and whether a body stands on a part of it.

use glam::{DMat2, DVec2, DVec3};

/// Minimum extent of the fixed part in every horizontal direction, relative to that of the body
/// (root mean squares).
const MIN_SUPPORT_RATIO: f64 = 0.1;

/// Returns the area of a convex polygon.
pub(super) fn polygon_area(corners: &[DVec3]) -> f64 {
    let [origin, rest @ ..] = corners else {
        return 0.0;
    };
    let triangles = rest.windows(2);
    triangles
        .map(|pair| 0.5 * (pair[0] - *origin).cross(pair[1] - *origin).length())
        .sum()
}

/// Whether points with the covariance `held` extend far enough, in every direction, beside those
/// with the covariance `own`.
pub(super) fn extends(held: &DMat2, own: &DMat2) -> bool {
    // Held − ratio² · own is positive definite.
    let rest = *held - MIN_SUPPORT_RATIO * MIN_SUPPORT_RATIO * *own;
    rest.x_axis.x > 0.0 && rest.determinant() > 0.0
}

/// Area and moments of a surface, projected along a coordinate axis.
pub(super) struct Moments {
    pub area: f64,
    first: DVec2,
    second: DMat2,
}

impl Moments {
    /// Those of nothing. (glam's default matrix is the identity.)
    pub const ZERO: Moments = Moments {
        area: 0.0,
        first: DVec2::ZERO,
        second: DMat2::ZERO,
    };

    /// Adds a convex polygon with its own area and the coordinates `a` and `b`.
    pub fn add_polygon(&mut self, corners: &[DVec3], a: usize, b: usize) {
        let [origin, rest @ ..] = corners else {
            return;
        };
        for pair in rest.windows(2) {
            let triangle = [*origin, pair[0], pair[1]];
            let area = 0.5 * (pair[0] - *origin).cross(pair[1] - *origin).length();
            let flat = triangle.map(|p| DVec2::new(p[a], p[b]));
            let sum: DVec2 = flat.iter().sum();
            self.area += area;
            self.first += area / 3.0 * sum;
            // ∫ p pᵀ = A/12 (Σ pᵢ pᵢᵀ + Σ pᵢ Σ pᵢᵀ)
            for p in flat.iter().chain([&sum]) {
                self.second += outer_product(*p) * (area / 12.0);
            }
        }
    }

    pub fn covariance(&self) -> DMat2 {
        if self.area <= 0.0 {
            return DMat2::ZERO;
        }
        self.second * (1.0 / self.area) - outer_product(self.first / self.area)
    }
}

fn outer_product(p: DVec2) -> DMat2 {
    DMat2::from_cols(p.x * p, p.y * p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariance_of_square() {
        let mut moments = Moments::ZERO;
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        moments.add_polygon(&square, 0, 1);
        let found = moments.covariance();
        assert!(
            (found.x_axis - DVec2::new(1.0 / 12.0, 0.0)).length() < 1e-12,
            "{found}"
        );
        assert!(
            (found.y_axis - DVec2::new(0.0, 1.0 / 12.0)).length() < 1e-12,
            "{found}"
        );
    }
}
