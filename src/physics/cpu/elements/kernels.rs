//! Energy, stress and Hessian of four tetrahedra at a time. They share no code with the reference
//! implementation in `physics::elements`.
//!
//! All formulas use G = F − I, which avoids cancellation at small strains:
//! |F|² − 3 = 2 tr G + |G|², J − 1 = tr G + tr cof G + det G.

use super::batch::{
    LaneMat3, LaneVec3, TetPoint, add_identity, cofactor, cofactor_from_gradient, cross, dot, times,
};
use super::svd::Svd;
use crate::physics::ConstitutiveModel;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::V4;
use crate::physics::model::elements::{CRUSH_STIFFNESS_RATIO, CRUSH_THRESHOLD_J};

/// Node pairs of a tetrahedron: the off-diagonal blocks of its stiffness matrix.
pub(in crate::physics::cpu) const NODE_PAIRS: [[usize; 2]; 6] =
    [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

impl<T: Real> TetPoint<T> {
    /// Returns the energy of each tetrahedron for the displacement gradient `g`.
    #[inline(always)]
    pub fn energy(&self, law: ConstitutiveModel, g: &LaneMat3<T::Lanes>) -> T::Lanes {
        let half = T::Lanes::splat(0.5);
        let mu = self.lame[0];
        let g_cofactor = cofactor(g);
        let trace_cofactor = g_cofactor[0][0] + g_cofactor[1][1] + g_cofactor[2][2];
        let det_g = dot(g_cofactor[0], g[0]);
        let volume_strain = (g[0][0] + g[1][1] + g[2][2]) + trace_cofactor + det_g;
        let shear = match law {
            ConstitutiveModel::NeoHookean => {
                let square = dot(g[0], g[0]) + dot(g[1], g[1]) + dot(g[2], g[2]);
                half * square - trace_cofactor - det_g
            }
            ConstitutiveModel::Corotated => {
                let m = Svd::new(g).stretch;
                dot(m, m)
            }
        };
        mu * shear + volumetric_energy(self.lame, volume_strain)
    }

    /// Whether any of the tetrahedra is inverted or flat.
    #[inline(always)]
    pub fn inverted(&self, g: &LaneMat3<T::Lanes>) -> bool {
        let volume_strain = cofactor_from_gradient(g).2;
        T::Lanes::splat(-1.0).any_above(volume_strain)
    }

    /// Returns P times the volume, as columns, and the energy. `extra_pressure` is an additional
    /// pressure times the volume, from outside the element's own law.
    #[inline(always)]
    pub fn stress(
        &self,
        law: ConstitutiveModel,
        g: &LaneMat3<T::Lanes>,
        extra_pressure: T::Lanes,
    ) -> (LaneMat3<T::Lanes>, T::Lanes) {
        let (c, cofactor_minus_identity, volume_strain) = cofactor_from_gradient(g);
        let mu = self.lame[0];
        let volumetric = volumetric_energy(self.lame, volume_strain);
        let pressure = volumetric_derivatives(self.lame, volume_strain)[0] + extra_pressure;
        match law {
            ConstitutiveModel::NeoHookean => {
                let square = dot(g[0], g[0]) + dot(g[1], g[1]) + dot(g[2], g[2]);
                let trace = g[0][0] + g[1][1] + g[2][2];
                let half = T::Lanes::splat(0.5);
                let energy = mu * (half * square - (volume_strain - trace)) + volumetric;
                // F − cof F, with the identity matrices cancelled analytically.
                let stress = combine(|j, i| {
                    mu * (g[j][i] - cofactor_minus_identity[j][i]) + pressure * c[j][i]
                });
                (stress, energy)
            }
            ConstitutiveModel::Corotated => {
                let svd = Svd::new(g);
                let m = svd.stretch;
                let energy = mu * dot(m, m) + volumetric;
                let deviatoric_stress = svd.compose(m.map(|x| (mu + mu) * x));
                (
                    combine(|j, i| deviatoric_stress[j][i] + pressure * c[j][i]),
                    energy,
                )
            }
        }
    }

    /// Returns the exact differential of P times the volume for a change `d` of F and a change of
    /// the additional pressure by the second number.
    #[inline(always)]
    pub fn stress_differential(
        &self,
        law: ConstitutiveModel,
        g: &LaneMat3<T::Lanes>,
        d: &LaneMat3<T::Lanes>,
        [extra_pressure, extra_pressure_change]: [T::Lanes; 2],
    ) -> LaneMat3<T::Lanes> {
        let mu = self.lame[0];
        let (c, _, volume_strain) = cofactor_from_gradient(g);
        let [law_pressure, stiffness] = volumetric_derivatives(self.lame, volume_strain);
        let pressure = law_pressure + extra_pressure;
        let change = stiffness * (dot(c[0], d[0]) + dot(c[1], d[1]) + dot(c[2], d[2]))
            + extra_pressure_change;
        let f = add_identity(g);
        let cofactor_differential = |j: usize| -> LaneVec3<T::Lanes> {
            let (k, l) = ((j + 1) % 3, (j + 2) % 3);
            let (a, b) = (cross(d[k], f[l]), cross(f[k], d[l]));
            std::array::from_fn(|i| a[i] + b[i])
        };
        let cofactor_differential: LaneMat3<T::Lanes> = std::array::from_fn(cofactor_differential);
        match law {
            ConstitutiveModel::NeoHookean => combine(|j, i| {
                mu * d[j][i] + change * c[j][i] + (pressure - mu) * cofactor_differential[j][i]
            }),
            ConstitutiveModel::Corotated => {
                let rotation_change = Svd::new(g).rotation_differential(d);
                let two = mu + mu;
                combine(|j, i| {
                    two * (d[j][i] - rotation_change[j][i])
                        + change * c[j][i]
                        + pressure * cofactor_differential[j][i]
                })
            }
        }
    }

    /// Computes the six off-diagonal blocks of the Hessian at constant additional pressure, in the
    /// order of [`NODE_PAIRS`], times `scale`.
    #[inline(always)]
    pub fn blocks(
        &self,
        (law, projected): (ConstitutiveModel, bool),
        g: &LaneMat3<T::Lanes>,
        extra_pressure: T::Lanes,
        scale: T::Lanes,
        mut emit: impl FnMut(usize, LaneMat3<T::Lanes>),
    ) {
        let lame = self.lame.map(|l| l * scale);
        let extra_pressure = extra_pressure * scale;
        let gradients = self.all_gradients();
        if law == ConstitutiveModel::NeoHookean && !projected {
            let f = add_identity(g);
            let (c, _, volume_strain) = cofactor_from_gradient(g);
            let mu = lame[0];
            let [law_pressure, lambda] = volumetric_derivatives(lame, volume_strain);
            let s = law_pressure + extra_pressure - mu;
            let cg = gradients.map(|g| times(&c, g));
            for (n, [a, b]) in NODE_PAIRS.iter().enumerate() {
                // μ g_a·g_b I + λ (C g_a)(C g_b)ᵀ − s [F (g_a × g_b)]×.
                let (ga, gb) = (gradients[*a], gradients[*b]);
                let along = mu * dot(ga, gb);
                let w = times(&f, cross(ga, gb)).map(|x| s * x);
                let left = cg[*a].map(|x| lambda * x);
                let mut block: LaneMat3<T::Lanes> =
                    std::array::from_fn(|j| left.map(|x| x * cg[*b][j]));
                for (k, column) in block.iter_mut().enumerate() {
                    column[k] = column[k] + along;
                }
                block[1][0] = block[1][0] + w[2];
                block[2][0] = block[2][0] - w[1];
                block[0][1] = block[0][1] - w[2];
                block[2][1] = block[2][1] + w[0];
                block[0][2] = block[0][2] + w[1];
                block[1][2] = block[1][2] - w[0];
                emit(n, block);
            }
        } else {
            let svd = Svd::new(g);
            let curvature = svd.curvature(law, lame, extra_pressure, projected);
            let principal_gradients = gradients.map(|g| svd.v.map(|v| dot(v, g)));
            for (n, [a, b]) in NODE_PAIRS.iter().enumerate() {
                emit(
                    n,
                    curvature.block(principal_gradients[*a], principal_gradients[*b]),
                );
            }
        }
    }

    /// Returns the shape function gradients of all four nodes.
    #[inline(always)]
    pub fn all_gradients(&self) -> [LaneVec3<T::Lanes>; 4] {
        let [a, b, c] = self.gradients;
        let rest = std::array::from_fn(|i| -(a[i] + b[i] + c[i]));
        [rest, a, b, c]
    }
}

impl<L: Lane> Svd<L> {
    /// Returns the differential of the rotation U Vᵀ for a change `d` of F, as columns.
    #[inline(always)]
    fn rotation_differential(&self, d: &LaneMat3<L>) -> LaneMat3<L> {
        // Uᵀ d V.
        let dv = self.v.map(|v| times(d, v));
        let inner: LaneMat3<L> =
            std::array::from_fn(|j| std::array::from_fn(|i| dot(self.u[i], dv[j])));
        let ridge = L::splat(1e-4);
        let spin = |i: usize, j: usize| {
            (inner[j][i] - inner[i][j]) / (self.sigma[i] + self.sigma[j]).max(ridge)
        };
        let zero = L::splat(0.0);
        let (a, b, c) = (spin(0, 1), spin(0, 2), spin(1, 2));
        // Skew-symmetric, as columns.
        let omega = [[zero, -a, -b], [a, zero, -c], [b, c, zero]];
        let uw = omega.map(|column| times(&self.u, column));
        let v = &self.v;
        combine(|j, i| uw[0][i] * v[0][j] + uw[1][i] * v[1][j] + uw[2][i] * v[2][j])
    }
}

/// Returns the volumetric energy at the volume ratio 1 + `volume_strain`.
#[inline(always)]
fn volumetric_energy<L: Lane>([mu, lambda]: [L; 2], volume_strain: L) -> L {
    let c = crush_ramp(volume_strain);
    let inverted_excess = (L::splat(-1.0) - volume_strain).max(L::splat(0.0));
    let bracket = L::splat(CRUSH_THRESHOLD_J / 12.0)
        + c * (c * L::splat(CRUSH_THRESHOLD_J / 30.0) - L::splat(CRUSH_THRESHOLD_J / 10.0));
    let square = c * c;
    let crush_term = square * square * bracket + L::splat(1.0 / 30.0) * inverted_excess;
    L::splat(0.5) * lambda * volume_strain * volume_strain
        + L::splat(16.0 * CRUSH_STIFFNESS_RATIO * CRUSH_THRESHOLD_J) * mu * crush_term
}

/// Returns the first and second derivatives of [`volumetric_energy`].
#[inline(always)]
pub(in crate::physics::cpu) fn volumetric_derivatives<L: Lane>(
    [mu, lambda]: [L; 2],
    volume_strain: L,
) -> [L; 2] {
    let c = crush_ramp(volume_strain);
    let square = c * c;
    let bracket = L::splat(1.0 / 3.0) + c * (c * L::splat(0.2) - L::splat(0.5));
    let crush_term =
        L::splat(16.0 * CRUSH_STIFFNESS_RATIO * CRUSH_THRESHOLD_J) * mu * square * c * bracket;
    let bump = c * (L::splat(1.0) - c);
    [
        lambda * volume_strain - crush_term,
        lambda + L::splat(16.0 * CRUSH_STIFFNESS_RATIO) * mu * bump * bump,
    ]
}

/// Returns 0 for a volume ratio 1 + `volume_strain` at or above the crush threshold, rising to 1 at
/// zero volume.
#[inline(always)]
fn crush_ramp<L: Lane>(volume_strain: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let c = ((L::splat(CRUSH_THRESHOLD_J - 1.0) - volume_strain)
        * L::splat(1.0 / CRUSH_THRESHOLD_J))
    .max(zero);
    c.select_greater(one, one, c)
}

#[inline(always)]
fn combine<L: Lane>(entry: impl Fn(usize, usize) -> L) -> LaneMat3<L> {
    std::array::from_fn(|j| std::array::from_fn(|i| entry(j, i)))
}

/// Returns the block of each tetrahedron, with padded columns.
#[inline(always)]
pub(super) fn unpack_blocks<T: Real>(block: &LaneMat3<T::Lanes>) -> [[V4<T>; 3]; 4] {
    let zero = T::Lanes::splat(0.0);
    let columns = block.map(|[x, y, z]| T::Lanes::transpose([x, y, z, zero]));
    std::array::from_fn(|l| columns.map(|c| T::array(c[l])))
}
