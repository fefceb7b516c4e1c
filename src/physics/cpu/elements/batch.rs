//! Batches of four tetrahedra, one per SIMD lane, with gather and scatter of nodal vectors.

use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::{V4, add, sub};

/// One vector per lane.
pub(in crate::physics::cpu) type LaneVec3<L> = [L; 3];

/// One 3×3 matrix per lane, as columns.
pub(in crate::physics::cpu) type LaneMat3<L> = [LaneVec3<L>; 3];

/// A quadrature point in each of four tetrahedra. Linear tets have one; its volume is theirs.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct TetPoint<T: Real> {
    /// Gradients of the last three barycentric coordinates.
    pub gradients: LaneMat3<T::Lanes>,
    /// Volume of the point times μ, and times λ as it enters the energy.
    pub lame: [T::Lanes; 2],
}

impl<T: Real> TetPoint<T> {
    /// Returns the displacement gradient Σ u_a ⊗ g_a, as columns, from the differences of the last
    /// three displacements to the first.
    #[inline(always)]
    pub fn gradient(&self, [a, b, c]: [LaneVec3<T::Lanes>; 3]) -> LaneMat3<T::Lanes> {
        let g = &self.gradients;
        std::array::from_fn(|j| {
            std::array::from_fn(|i| a[i] * g[0][j] + b[i] * g[1][j] + c[i] * g[2][j])
        })
    }
}

/// Four linear tetrahedra; the padding of the last batch of a list has zero volume.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct TetBatch<T: Real> {
    /// Nodes of each tetrahedron, ascending in the engine's order.
    pub nodes: [[u32; 4]; 4],
    /// Shape function gradients and material.
    pub point: TetPoint<T>,
}

impl<T: Real> TetBatch<T> {
    /// Returns the displacement gradient Σ u_a ⊗ g_a, as columns: F − I if `u` are displacements.
    #[inline(always)]
    pub fn gradient(&self, u: &[V4<T>]) -> LaneMat3<T::Lanes> {
        let mut edges = [[T::Lanes::splat(0.0); 3]; 3];
        for (k, edge) in edges.iter_mut().enumerate() {
            let tets = self
                .nodes
                .map(|n| T::lanes(&u[n[k + 1] as usize]) - T::lanes(&u[n[0] as usize]));
            let [x, y, z, _] = T::Lanes::transpose(tets);
            *edge = [x, y, z];
        }
        self.point.gradient(edges)
    }

    /// Adds −P g_a to the nodes that lie within `out`, which begins with node `first`.
    #[inline(always)]
    pub fn scatter<const INNER: bool>(
        &self,
        stress: &LaneMat3<T::Lanes>,
        first: usize,
        out: &mut [V4<T>],
    ) {
        let zero = T::Lanes::splat(0.0);
        let shares: [[V4<T>; 4]; 3] = std::array::from_fn(|k| {
            let g = &self.point.gradients[k];
            let f: LaneVec3<T::Lanes> = std::array::from_fn(|i| {
                -(stress[0][i] * g[0] + stress[1][i] * g[1] + stress[2][i] * g[2])
            });
            T::Lanes::transpose([f[0], f[1], f[2], zero]).map(T::array)
        });
        for (l, nodes) in self.nodes.iter().enumerate() {
            let [a, b, c] = [shares[0][l], shares[1][l], shares[2][l]];
            let rest = sub(sub(sub([T::ZERO; 4], a), b), c);
            for (v, f) in nodes.iter().zip([rest, a, b, c]) {
                // For nodes before the chunk the subtraction wraps around to an index past its end.
                let place = (*v as usize).wrapping_sub(first);
                if INNER {
                    out[place] = add(out[place], f);
                } else if let Some(out) = out.get_mut(place) {
                    *out = add(*out, f);
                }
            }
        }
    }
}

#[inline(always)]
pub(in crate::physics::cpu) fn dot<L: Lane>(a: LaneVec3<L>, b: LaneVec3<L>) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(in crate::physics::cpu) fn cross<L: Lane>(a: LaneVec3<L>, b: LaneVec3<L>) -> LaneVec3<L> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Returns m a.
#[inline(always)]
pub(in crate::physics::cpu) fn times<L: Lane>(m: &LaneMat3<L>, a: LaneVec3<L>) -> LaneVec3<L> {
    std::array::from_fn(|i| m[0][i] * a[0] + m[1][i] * a[1] + m[2][i] * a[2])
}

/// Returns the cofactor matrix.
#[inline(always)]
pub(in crate::physics::cpu) fn cofactor<L: Lane>(m: &LaneMat3<L>) -> LaneMat3<L> {
    [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])]
}

/// Returns cof(I + G), cof(I + G) − I and J − 1, free of cancellation: cof(I + G) = I + tr G I −
/// Gᵀ + cof G and J − 1 = tr G + tr cof G + det G.
#[inline(always)]
pub(in crate::physics::cpu) fn cofactor_from_gradient<L: Lane>(
    g: &LaneMat3<L>,
) -> (LaneMat3<L>, LaneMat3<L>, L) {
    let g_cofactor = cofactor(g);
    let trace = g[0][0] + g[1][1] + g[2][2];
    let volume_strain =
        trace + (g_cofactor[0][0] + g_cofactor[1][1] + g_cofactor[2][2]) + dot(g_cofactor[0], g[0]);
    let cofactor_minus_identity: LaneMat3<L> = std::array::from_fn(|j| {
        std::array::from_fn(|i| {
            let c = g_cofactor[j][i] - g[i][j];
            if i == j { c + trace } else { c }
        })
    });
    (
        add_identity(&cofactor_minus_identity),
        cofactor_minus_identity,
        volume_strain,
    )
}

/// Returns I + m.
#[inline(always)]
pub(in crate::physics::cpu) fn add_identity<L: Lane>(m: &LaneMat3<L>) -> LaneMat3<L> {
    let mut out = *m;
    for (k, column) in out.iter_mut().enumerate() {
        column[k] = column[k] + L::splat(1.0);
    }
    out
}
