//! Six-node faces of ten-node tets under pressure.
//!
//! With barycentric coordinates L of a face the shape functions are N_a = L_a (2 L_a − 1) at its corners
//! and N_ab = 4 L_a L_b at the middles of its edges. A pressure p has the consistent nodal forces
//! f_a = −p ∫ N_a ∂x/∂L₁ × ∂x/∂L₂ over the unit triangle, with x = Σ N_b x_b (Zienkiewicz, Taylor &
//! Zhu 2013, "The Finite Element Method: Its Basis and Fundamentals", section 6.3). The integrand is of
//! degree 4, for which six points are exact (Dunavant 1985, "High Degree Efficient Symmetrical
//! Gaussian Quadrature Rules for the Triangle").

use super::pressure::LoadedFace;
use super::scalar::Real;
use super::vectors::{V4, add, add_scaled, cross, from_metres, scale, sub, zero};
use glam::DVec3;
use std::collections::BTreeMap;

/// Number of nodes: corners a, b, c, counter-clockwise seen from outside, then the middles of ab, bc and
/// ca.
pub(super) const FACE_NODES: usize = 6;

/// Number of quadrature points.
const POINTS: usize = 6;

/// Two barycentric coordinates of three points each, with their weights; all weights sum to 1.
const RULE: [[f64; 2]; 2] = [
    [0.445_948_490_915_964_9, 0.223_381_589_678_011_47],
    [0.091_576_213_509_770_75, 0.109_951_743_655_321_87],
];

/// Shape functions and their derivatives at a quadrature point.
struct ShapePoint {
    weight: f64,
    values: [f64; FACE_NODES],
    /// By L₁ and by L₂, with L₀ = 1 − L₁ − L₂.
    derivatives: [[f64; FACE_NODES]; 2],
}

/// The quadrature points.
const SHAPE: [ShapePoint; POINTS] = [
    shape_point(0),
    shape_point(1),
    shape_point(2),
    shape_point(3),
    shape_point(4),
    shape_point(5),
];

const fn shape_point(point: usize) -> ShapePoint {
    let [twice, weight] = RULE[point / 3];
    let mut l = [twice; 3];
    l[point % 3] = 1.0 - 2.0 * twice;
    let [p, q, r] = l;
    ShapePoint {
        weight,
        values: [
            p * (2.0 * p - 1.0),
            q * (2.0 * q - 1.0),
            r * (2.0 * r - 1.0),
            4.0 * p * q,
            4.0 * q * r,
            4.0 * r * p,
        ],
        derivatives: [
            [
                1.0 - 4.0 * p,
                4.0 * q - 1.0,
                0.0,
                4.0 * (p - q),
                4.0 * r,
                -4.0 * r,
            ],
            [
                1.0 - 4.0 * p,
                0.0,
                4.0 * r - 1.0,
                -4.0 * q,
                4.0 * q,
                4.0 * (p - r),
            ],
        ],
    }
}

/// A six-node face.
#[derive(Clone, Debug)]
pub(super) struct SixNodeFace<T> {
    /// Its nodes, in the engine's order.
    pub nodes: [u32; FACE_NODES],
    /// ∂x/∂L₁ and ∂x/∂L₂ at rest at each quadrature point.
    tangents: [[V4<T>; 2]; POINTS],
}

impl<T: Real> SixNodeFace<T> {
    /// Creates the face of `nodes`, with rest positions `rest` (m), in the unit `length`, m.
    pub fn new(nodes: [u32; FACE_NODES], rest: [DVec3; FACE_NODES], length: f64) -> SixNodeFace<T> {
        let along = |derivatives: &[f64; FACE_NODES]| -> DVec3 {
            let all = rest.iter().zip(derivatives);
            all.map(|(x, d)| *d * (*x - rest[0])).sum()
        };
        SixNodeFace {
            nodes,
            tangents: std::array::from_fn(|point| {
                let shape = &SHAPE[point];
                std::array::from_fn(|k| from_metres(along(&shape.derivatives[k]), length))
            }),
        }
    }

    /// Returns ∂x/∂L₁ and ∂x/∂L₂ at each quadrature point, at the displacements `u`.
    #[inline]
    fn tangents(&self, u: &[V4<T>]) -> [[V4<T>; 2]; POINTS] {
        // The derivatives of all shape functions sum to zero.
        let first = u[self.nodes[0] as usize];
        let moved = self.nodes.map(|v| sub(u[v as usize], first));
        let mut tangents = self.tangents;
        for (point, shape) in tangents.iter_mut().zip(&SHAPE) {
            for (tangent, derivatives) in point.iter_mut().zip(&shape.derivatives) {
                for (d, by) in moved.iter().zip(derivatives).skip(1) {
                    *tangent = add_scaled(*tangent, T::from_f64(*by), *d);
                }
            }
        }
        tangents
    }

    /// Returns 2 ∫ N_a n dA for each node, with the outward normal n, at the displacements `u`.
    #[inline]
    pub fn area_vectors(&self, u: &[V4<T>]) -> [V4<T>; FACE_NODES] {
        let mut sums = [zero(); FACE_NODES];
        for ([first, second], shape) in self.tangents(u).into_iter().zip(&SHAPE) {
            let normal = scale(T::from_f64(shape.weight), cross(first, second));
            for (sum, value) in sums.iter_mut().zip(shape.values) {
                *sum = add_scaled(*sum, T::from_f64(value), normal);
            }
        }
        sums
    }

    /// Adds the derivatives of Σ_a y_a·[`SixNodeFace::area_vectors`] by the displacements to `out`.
    pub fn add_area_derivatives(&self, u: &[V4<T>], y: &[V4<T>; FACE_NODES], out: &mut [V4<T>]) {
        for ([first, second], shape) in self.tangents(u).into_iter().zip(&SHAPE) {
            let mut sum = zero();
            for (y, value) in y.iter().zip(shape.values) {
                sum = add_scaled(sum, T::from_f64(shape.weight * value), *y);
            }
            let (by_first, by_second) = (cross(second, sum), cross(sum, first));
            for (n, v) in self.nodes.iter().enumerate() {
                let [a, b] = [0, 1].map(|k| T::from_f64(shape.derivatives[k][n]));
                let out = &mut out[*v as usize];
                *out = add(*out, add_scaled(scale(a, by_first), b, by_second));
            }
        }
    }
}

/// Returns the six-node faces of which `faces` has all four pieces, and the faces that are none of
/// these, in their order. A piece has one corner of its face and two middles, or all three middles.
pub(super) fn join_pieces(faces: &[LoadedFace]) -> (Vec<[u32; FACE_NODES]>, Vec<LoadedFace>) {
    // The pieces at corners by the side across the corner, as the inner piece has it.
    let mut at_corners: BTreeMap<[u32; 2], Vec<(usize, u32)>> = BTreeMap::new();
    for (i, (nodes, is_middle)) in faces.iter().enumerate() {
        if is_middle.iter().filter(|is| !**is).count() != 1 {
            continue;
        }
        if let Some(k) = is_middle.iter().position(|is| !is) {
            let side = [nodes[(k + 2) % 3], nodes[(k + 1) % 3]];
            at_corners.entry(side).or_default().push((i, nodes[k]));
        }
    }
    let mut is_joined = vec![false; faces.len()];
    let mut joined = Vec::new();
    for (i, ([ab, bc, ca], is_middle)) in faces.iter().enumerate() {
        if *is_middle != [true; 3] {
            continue;
        }
        let sides = [[*ca, *ab], [*ab, *bc], [*bc, *ca]];
        let last = |side: &[u32; 2]| at_corners.get(side)?.last().copied();
        let [Some(a), Some(b), Some(c)] = sides.each_ref().map(last) else {
            continue;
        };
        // Pieces around one corner are those of several faces.
        if a.1 == b.1 || b.1 == c.1 || c.1 == a.1 {
            continue;
        }
        joined.push([a.1, b.1, c.1, *ab, *bc, *ca]);
        for (side, (piece, _)) in sides.iter().zip([a, b, c]) {
            at_corners.entry(*side).or_default().pop();
            is_joined[piece] = true;
        }
        is_joined[i] = true;
    }
    let others = faces.iter().zip(is_joined).filter(|(_, is)| !is);
    (joined, others.map(|(face, _)| *face).collect())
}
