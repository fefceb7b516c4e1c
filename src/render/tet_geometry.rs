//! Normals and gradients of tets; reference of `shaders/render/refresh_geometry.wgsl`.

use super::Geometry;
use crate::mesh::FACES;
use glam::DVec3;

impl Geometry {
    /// Returns the face planes of a tet: (outward unit normal n, n · v) for a positively oriented tet.
    pub fn reference_tet_planes(v: [DVec3; 4]) -> [(DVec3, f64); 4] {
        FACES.map(|[a, b, c]| {
            let normal = (v[b] - v[a]).cross(v[c] - v[a]).normalize_or_zero();
            (normal, normal.dot(v[a]))
        })
    }

    /// Returns the gradient of the linear function with values `s` at the corners `v`.
    ///
    /// g = Σ (s_i − s_0) ∇λ_i with ∇λ_1 = (e_2 × e_3) / det and so on, e_i = v_i − v_0; equivalent to
    /// the paper's formula with face normals.
    pub fn reference_tet_gradient(v: [DVec3; 4], s: [f64; 4]) -> DVec3 {
        let e = [1, 2, 3].map(|i| v[i] - v[0]);
        let det = e[0].dot(e[1].cross(e[2]));
        let rise = (s[1] - s[0]) * e[1].cross(e[2])
            + (s[2] - s[0]) * e[2].cross(e[0])
            + (s[3] - s[0]) * e[0].cross(e[1]);
        rise / det
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tet_gradient_matches_linear_function() {
        let v = [
            DVec3::new(0.1, 0.2, 0.3),
            DVec3::new(1.1, 0.1, 0.2),
            DVec3::new(0.3, 1.4, 0.1),
            DVec3::new(0.2, 0.3, 0.9),
        ];
        let g = DVec3::new(0.7, -2.0, 0.4);
        let got = Geometry::reference_tet_gradient(v, v.map(|p| g.dot(p) + 5.0));
        assert!((got - g).length() < 1e-12);
        for (i, (normal, offset)) in Geometry::reference_tet_planes(v).into_iter().enumerate() {
            assert!(normal.dot(v[i]) < offset, "face {i} looks inwards");
            let on_it = FACES[i].map(|k| (normal.dot(v[k]) - offset).abs());
            assert!(on_it.into_iter().fold(0.0, f64::max) < 1e-12);
        }
    }
}
