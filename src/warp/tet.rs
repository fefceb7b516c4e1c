//! Point location in a tetrahedron, and its affine displacement.

use glam::{DMat3, DVec3};

/// Degenerate below this fraction of the cube of the longest edge.
const FLAT: f64 = 1e-12;

/// Tolerance outside of a face within which a point still counts as on it: in voxels, or as a
/// weight for thinner tetrahedra. Far above rounding, far below visibility.
const FACE_TOLERANCE: f64 = 1e-6;

/// Whether a tetrahedron is neither degenerate nor inverted.
pub(super) fn has_volume([a, b, c, d]: [DVec3; 4]) -> bool {
    let [x, y, z] = [b - a, c - a, d - a];
    let edges = [x, y, z, y - x, z - y, x - z];
    let longest = edges.iter().map(|e| e.length_squared()).fold(0.0, f64::max);
    x.cross(y).dot(z) > FLAT * longest.sqrt().powi(3)
}

/// Barycentric weights in a tetrahedron, as affine functions of the position.
#[derive(Clone, Copy)]
pub(super) struct Weights {
    pub origin: DVec3,
    /// Gradient of each weight; at the origin the first weight is 1, the others 0.
    pub gradients: [DVec3; 4],
    /// Tolerance below 0 of each weight on the tetrahedron's faces.
    pub slack: [f64; 4],
}

impl Weights {
    /// Creates the weights of a non-degenerate tetrahedron, in a frame with a unit of about a
    /// voxel.
    pub fn new([a, b, c, d]: [DVec3; 4]) -> Weights {
        let inverse = DMat3::from_cols(b - a, c - a, d - a).inverse().transpose();
        let [x, y, z] = [inverse.x_axis, inverse.y_axis, inverse.z_axis];
        let gradients = [-(x + y + z), x, y, z];
        Weights {
            origin: a,
            gradients,
            slack: gradients.map(|slope| FACE_TOLERANCE * slope.length().min(1.0)),
        }
    }

    /// Returns the weights at `p`.
    pub fn at(&self, p: DVec3) -> [f64; 4] {
        let [x, y, z] = [1, 2, 3].map(|n| self.gradients[n].dot(p - self.origin));
        [1.0 - x - y - z, x, y, z]
    }

    /// Whether a point with these weights is in the tetrahedron, including its faces; and whether
    /// it is strictly inside.
    pub fn contains(&self, weights: [f64; 4]) -> (bool, bool) {
        let (mut holds, mut inside) = (true, true);
        for (w, slack) in weights.into_iter().zip(self.slack) {
            holds &= w >= -slack;
            inside &= w > slack;
        }
        (holds, inside)
    }
}

/// Displacement in a tetrahedron as an affine function of the position: exactly 0 if the
/// tetrahedron does not move, whatever the rounding of the weights.
#[derive(Clone, Copy)]
pub(super) struct AffineDisplacement {
    origin: DVec3,
    first: DVec3,
    /// Displacement gradient.
    slope: DMat3,
}

impl AffineDisplacement {
    /// Creates the displacement of a tetrahedron with `weights` and these corner displacements.
    pub fn new(weights: &Weights, [a, b, c, d]: [DVec3; 4]) -> AffineDisplacement {
        let [_, x, y, z] = weights.gradients;
        let rows = DMat3::from_cols(x, y, z).transpose();
        AffineDisplacement {
            origin: weights.origin,
            first: a,
            slope: DMat3::from_cols(b - a, c - a, d - a) * rows,
        }
    }

    pub fn at(&self, p: DVec3) -> DVec3 {
        self.first + self.slope * (p - self.origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 4] = [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(4.0, 1.0, 1.0),
        DVec3::new(1.0, 4.0, 1.0),
        DVec3::new(1.0, 1.0, 4.0),
    ];

    #[test]
    fn weights_are_one_at_corner_and_distinguish_inside_from_face() {
        let weights = Weights::new(CORNERS);
        for (n, corner) in CORNERS.into_iter().enumerate() {
            for (m, w) in weights.at(corner).into_iter().enumerate() {
                assert!((w - f64::from(u8::from(m == n))).abs() < 1e-15);
            }
            assert_eq!(weights.contains(weights.at(corner)), (true, false));
        }
        let of = |x, y, z| weights.contains(weights.at(DVec3::new(x, y, z)));
        assert_eq!(of(1.5, 1.5, 1.5), (true, true));
        assert_eq!(of(2.0, 2.0, 2.0), (true, false));
        assert_eq!(of(1.5, 1.5, 1.0), (true, false));
        assert_eq!(of(1.5, 1.5, 0.99), (false, false));
        assert_eq!(of(2.1, 2.1, 2.1), (false, false));
    }

    #[test]
    fn displacement_equals_corner_displacements() {
        let turn = DMat3::from_rotation_z(0.3);
        let moved = CORNERS.map(|p| turn * p - p);
        let shift = AffineDisplacement::new(&Weights::new(CORNERS), moved);
        let p = DVec3::new(1.7, 1.2, 2.1);
        assert!((p + shift.at(p)).abs_diff_eq(turn * p, 1e-14));
        let none = AffineDisplacement::new(&Weights::new(CORNERS), [DVec3::ZERO; 4]);
        assert_eq!(none.at(p), DVec3::ZERO);
    }

    #[test]
    fn inverted_or_flat_tet_has_no_volume() {
        let [a, b, c, d] = CORNERS;
        assert!(has_volume(CORNERS));
        assert!(!has_volume([a, c, b, d]));
        assert!(!has_volume([a, b, c, a + 0.3 * (b - a) + 0.2 * (c - a)]));
    }
}
