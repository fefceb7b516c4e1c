//! Quality of a tet as one number, computed without trigonometric functions.

use glam::DVec3;

/// Factor on the sine of obtuse angles: with it, the bounds of 10.7° and 164.8° are about
/// equivalent.
const OBTUSE_PENALTY: f64 = 0.7;

/// Returns the minimum sine of the dihedral angles, with a factor of 0.7 for obtuse ones; −1 for
/// inverted or flat tets.
pub(super) fn quality(v: [DVec3; 4]) -> f64 {
    let [a, b, c] = [v[1] - v[0], v[2] - v[0], v[3] - v[0]];
    let volume = a.cross(b).dot(c);
    if volume <= 0.0 {
        return -1.0;
    }
    // Twice the area vectors of the faces opposite 0, 1, 2, 3, pointing outward.
    let n = [(b - a).cross(c - a), c.cross(b), a.cross(c), b.cross(a)];
    let size = n.map(|n| n.length());
    // Each edge with its two faces.
    let edges = [
        (a, 2, 3),
        (b, 1, 3),
        (c, 1, 2),
        (b - a, 0, 3),
        (c - a, 0, 2),
        (c - b, 0, 1),
    ];
    let mut least = f64::INFINITY;
    for (edge, i, j) in edges {
        let sine = volume * edge.length() / (size[i] * size[j]);
        let weighed = match n[i].dot(n[j]) > 0.0 {
            true => OBTUSE_PENALTY * sine,
            false => sine,
        };
        least = least.min(weighed);
    }
    if least.is_finite() { least } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TetQuality;

    #[test]
    fn quality_equals_min_weighted_sine_of_dihedral_angles() {
        let tets = [
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.4, 0.4, 0.1)],
            [
                DVec3::ZERO,
                DVec3::X,
                DVec3::new(0.5, 0.2, 0.0),
                DVec3::new(0.3, -0.4, 1.7),
            ],
        ];
        for tet in tets {
            let weighed = TetQuality::dihedral_angles(tet)
                .map(|a| a.to_radians().sin() * if a > 90.0 { OBTUSE_PENALTY } else { 1.0 });
            let least = weighed.into_iter().fold(f64::INFINITY, f64::min);
            let mut of = tet;
            if crate::mesh::signed_volume(of) < 0.0 {
                of.swap(0, 1);
            }
            assert!(
                (quality(of) - least).abs() < 1e-12,
                "{} {least}",
                quality(of)
            );
            of.swap(0, 1);
            assert_eq!(quality(of), -1.0);
        }
    }
}
