//! Branch-free singular value decomposition F = U Σ Vᵀ of four tetrahedra at a time, and the
//! Hessian of isotropic energies in that frame.
//!
//! U and V are rotations; of the σ, in descending order of magnitude, only the last is negative, if
//! F is inverted. The Hessian of Ψ(σ) with respect to F in that frame (Stomakhin et al. 2012;
//! Smith, de Goes & Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies") consists
//! of the 3×3 matrix ∂²Ψ/∂σ² and, for each pair of axes, a twist (Ψ_i + Ψ_j)/(σ_i + σ_j) and a flip
//! (Ψ_i − Ψ_j)/(σ_i − σ_j).

use super::batch::{LaneMat3, LaneVec3, add_identity, cross, dot, times};
use crate::physics::ConstitutiveModel;
use crate::physics::cpu::simd::Lane;

/// Lower bound of the denominator of a twist: the corotated energy has a ridge where it is zero.
pub(super) const MIN_TWIST_DENOMINATOR: f64 = 1e-4;

/// Singular value decomposition of F.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct Svd<L> {
    /// Columns.
    pub u: LaneMat3<L>,
    /// Columns.
    pub v: LaneMat3<L>,
    /// Σ.
    pub sigma: LaneVec3<L>,
    /// Σ − 1.
    pub stretch: LaneVec3<L>,
}

/// Hessian of the energy with respect to F, times the volume, in the principal frame of the
/// tetrahedron.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct PrincipalHessian<L> {
    u: LaneMat3<L>,
    /// xx, yy, zz, yz, xz, xy of ∂²Ψ/∂σ².
    a: [L; 6],
    /// Derivative of P_ij with respect to F_ij, where k is neither i nor j.
    p: LaneVec3<L>,
    /// Derivative of P_ij with respect to F_ji.
    q: LaneVec3<L>,
}

/// One Jacobi rotation: makes a_pq zero.
#[inline(always)]
fn rotate<L: Lane>(a: &mut LaneMat3<L>, v: &mut LaneMat3<L>, p: usize, q: usize) {
    let (one, four) = (L::splat(1.0), L::splat(4.0));
    let d = a[q][q] - a[p][p];
    let apq = a[p][q];
    let denominator = d.abs() + (d * d + four * apq * apq).sqrt();
    let t = (apq + apq) / denominator.select_greater(L::splat(0.0), denominator, one);
    let t = L::splat(0.0).select_greater(d, -t, t);
    let c = one / (t * t + one).sqrt();
    let s = t * c;
    let r = 3 - p - q;
    let (arp, arq) = (a[r][p], a[r][q]);
    a[p][p] = a[p][p] - t * apq;
    a[q][q] = a[q][q] + t * apq;
    a[p][q] = L::splat(0.0);
    a[q][p] = a[p][q];
    a[r][p] = c * arp - s * arq;
    a[p][r] = a[r][p];
    a[r][q] = s * arp + c * arq;
    a[q][r] = a[r][q];
    let (x, y) = (v[p], v[q]);
    v[p] = std::array::from_fn(|i| c * x[i] - s * y[i]);
    v[q] = std::array::from_fn(|i| s * x[i] + c * y[i]);
}

/// Diagonalises a symmetric matrix by Jacobi sweeps; returns its eigenvectors as columns.
#[inline(always)]
fn diagonalise<L: Lane>(a: &mut LaneMat3<L>) -> LaneMat3<L> {
    let mut v = add_identity(&[[L::splat(0.0); 3]; 3]);
    for _ in 0..L::SWEEPS {
        let diagonal_norm_squared = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
        let off_diagonal_norm_squared = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        if !off_diagonal_norm_squared
            .any_above(diagonal_norm_squared * L::splat(L::OFF_DIAGONAL_TOLERANCE))
        {
            break;
        }
        rotate(a, &mut v, 0, 1);
        rotate(a, &mut v, 0, 2);
        rotate(a, &mut v, 1, 2);
    }
    v
}

/// Orthogonalises two columns of W = F V, rotating those of V with them (Hestenes' one-sided Jacobi
/// rotation); does nothing if they are orthogonal up to rounding.
#[inline(always)]
fn orthogonalise_columns<L: Lane>(w: &mut LaneMat3<L>, v: &mut LaneMat3<L>, p: usize, q: usize) {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let (a, b, c) = (dot(w[p], w[p]), dot(w[q], w[q]), dot(w[p], w[q]));
    let d = b - a;
    let denominator = d.abs() + (d * d + L::splat(4.0) * c * c).sqrt();
    let t = (c + c) / denominator.select_greater(zero, denominator, one);
    let t = zero.select_greater(d, -t, t);
    // Squares of small stretches stay in the range of f32 if the stretches are above 1e-9.
    let tan_theta = (c * c).select_greater(L::splat(L::ORTHOGONALITY_TOLERANCE) * a * b, t, zero);
    let cos = one / (tan_theta * tan_theta + one).sqrt();
    let sin = tan_theta * cos;
    for m in [w, v] {
        let (x, y) = (m[p], m[q]);
        m[p] = std::array::from_fn(|i| cos * x[i] - sin * y[i]);
        m[q] = std::array::from_fn(|i| sin * x[i] + cos * y[i]);
    }
}

impl<L: Lane> Svd<L> {
    /// Decomposes F = I + `g`.
    #[inline(always)]
    pub fn new(g: &LaneMat3<L>) -> Svd<L> {
        // FᵀF − I, free of cancellation; its eigenvalues are σ² − 1.
        let strain: LaneMat3<L> =
            std::array::from_fn(|j| std::array::from_fn(|i| g[j][i] + g[i][j] + dot(g[i], g[j])));
        let mut v = diagonalise(&mut { strain });
        let f = add_identity(g);
        let mut w = v.map(|v| times(&f, v));
        // For a tetrahedron that is nearly a line or a point, the strain is not accurate enough.
        for _ in 0..3 {
            let is_not_orthogonal = |p: usize, q: usize| {
                let (a, b, c) = (dot(w[p], w[p]), dot(w[q], w[q]), dot(w[p], w[q]));
                (c * c).any_above(L::splat(L::ORTHOGONALITY_TOLERANCE) * a * b)
            };
            if !(is_not_orthogonal(0, 1) || is_not_orthogonal(0, 2) || is_not_orthogonal(1, 2)) {
                break;
            }
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                orthogonalise_columns(&mut w, &mut v, p, q);
            }
        }
        let mut e: LaneVec3<L> = std::array::from_fn(|k| dot(v[k], times(&strain, v[k])));
        let mut n = w.map(|w| dot(w, w));
        for (p, q) in [(0, 1), (1, 2), (0, 1)] {
            let (a, b) = (n[p], n[q]);
            n[p] = b.select_greater(a, b, a);
            n[q] = b.select_greater(a, a, b);
            (e[p], e[q]) = (
                b.select_greater(a, e[q], e[p]),
                b.select_greater(a, e[p], e[q]),
            );
            // Rotated by 90° instead of swapped, so that V stays a rotation.
            for m in [&mut v, &mut w] {
                let (x, y) = (m[p], m[q]);
                m[p] = std::array::from_fn(|i| b.select_greater(a, y[i], x[i]));
                m[q] = std::array::from_fn(|i| b.select_greater(a, -x[i], y[i]));
            }
        }
        let (zero, one, tiny) = (L::splat(0.0), L::splat(1.0), L::splat(L::TINY));
        let n0 = dot(w[0], w[0]);
        let point = L::splat(1e-30);
        let over = one / n0.select_greater(point, n0, one).sqrt();
        // A tetrahedron collapsed to a point may use any frame; one collapsed to a line, any
        // direction perpendicular to it.
        let u0: LaneVec3<L> = std::array::from_fn(|i| {
            n0.select_greater(point, w[0][i] * over, if i == 0 { one } else { zero })
        });
        let d = dot(u0, w[1]);
        let across: LaneVec3<L> = std::array::from_fn(|i| w[1][i] - d * u0[i]);
        let x = u0[0].abs().select_greater(L::splat(0.8), zero, one);
        let any = cross(u0, [x, one - x, zero]);
        let thin = tiny * n0 + point;
        let n1 = dot(across, across);
        let u1: LaneVec3<L> = std::array::from_fn(|i| n1.select_greater(thin, across[i], any[i]));
        let over = one / dot(u1, u1).sqrt();
        let u1 = u1.map(|x| x * over);
        // For a nearly collapsed tetrahedron, rounding leaves a component along u0.
        let d = dot(u0, u1);
        let u1: LaneVec3<L> = std::array::from_fn(|i| u1[i] - d * u0[i]);
        let over = one / dot(u1, u1).sqrt();
        let u1 = u1.map(|x| x * over);
        let u = [u0, u1, cross(u0, u1)];
        let sigma: LaneVec3<L> = std::array::from_fn(|i| dot(u[i], w[i]));
        let stretch = std::array::from_fn(|i| {
            let s = sigma[i];
            s.select_greater(L::splat(0.5), e[i] / (one + s.max(zero)), s - one)
        });
        Svd {
            u,
            v,
            sigma,
            stretch,
        }
    }

    /// Returns the decomposition with stretches that are larger by `by`, in the same frame.
    #[inline(always)]
    pub fn stretched(&self, by: LaneVec3<L>) -> Svd<L> {
        Svd {
            sigma: std::array::from_fn(|i| self.sigma[i] + by[i]),
            stretch: std::array::from_fn(|i| self.stretch[i] + by[i]),
            ..*self
        }
    }

    /// Returns U d Vᵀ for a diagonal d, as columns.
    #[inline(always)]
    pub fn compose(&self, d: LaneVec3<L>) -> LaneMat3<L> {
        let v = &self.v;
        let scaled: LaneMat3<L> = std::array::from_fn(|k| self.u[k].map(|x| x * d[k]));
        std::array::from_fn(|j| {
            std::array::from_fn(|i| {
                scaled[0][i] * v[0][j] + scaled[1][i] * v[1][j] + scaled[2][i] * v[2][j]
            })
        })
    }

    /// Returns the Hessian of `law` at constant additional pressure `extra_pressure`, scaled like
    /// `lame` and `extra_pressure`; with negative eigenvalues clamped to zero if `projected`.
    #[inline(always)]
    pub fn curvature(
        &self,
        law: ConstitutiveModel,
        [mu, lambda]: [L; 2],
        extra_pressure: L,
        projected: bool,
    ) -> PrincipalHessian<L> {
        let (s, one, half, zero) = (self.sigma, L::splat(1.0), L::splat(0.5), L::splat(0.0));
        let m = &self.stretch;
        // J − 1 from the stretches.
        let pairs = m[0] * m[1] + m[1] * m[2] + m[2] * m[0];
        let volume_strain = (m[0] + m[1] + m[2]) + pairs + m[0] * m[1] * m[2];
        let [law_pressure, lambda] =
            super::kernels::volumetric_derivatives([mu, lambda], volume_strain);
        let pressure = law_pressure + extra_pressure;
        let cofactors = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
        let clamp = |x: L| if projected { x.max(zero) } else { x };
        let off_diagonal = match law {
            ConstitutiveModel::NeoHookean => pressure - mu,
            ConstitutiveModel::Corotated => pressure,
        };
        let (mut p, mut q) = ([zero; 3], [zero; 3]);
        for k in 0..3 {
            let (twist, flip) = match law {
                ConstitutiveModel::NeoHookean => {
                    (mu + off_diagonal * s[k], mu - off_diagonal * s[k])
                }
                ConstitutiveModel::Corotated => {
                    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                    let sum = (s[i] + s[j]).max(L::splat(MIN_TWIST_DENOMINATOR));
                    let two = mu + mu;
                    // 2 μ (σ_i + σ_j − 2)/(σ_i + σ_j).
                    (
                        two * (m[i] + m[j]) / sum + off_diagonal * s[k],
                        two - off_diagonal * s[k],
                    )
                }
            };
            let (twist, flip) = (clamp(twist), clamp(flip));
            p[k] = half * (twist + flip);
            q[k] = half * (flip - twist);
        }
        let shear = match law {
            ConstitutiveModel::NeoHookean => mu,
            ConstitutiveModel::Corotated => mu + mu,
        };
        let j = volume_strain + one;
        let mut a: LaneMat3<L> = std::array::from_fn(|i| {
            std::array::from_fn(|k| match i == k {
                true => shear + lambda * cofactors[i] * cofactors[i],
                false => s[3 - i - k] * (lambda * j + off_diagonal),
            })
        });
        if projected {
            let v = diagonalise(&mut a);
            let e = [a[0][0], a[1][1], a[2][2]].map(|x| x.max(zero));
            a = std::array::from_fn(|i| {
                std::array::from_fn(|k| {
                    e[0] * v[0][i] * v[0][k] + e[1] * v[1][i] * v[1][k] + e[2] * v[2][i] * v[2][k]
                })
            });
        }
        PrincipalHessian {
            u: self.u,
            a: [a[0][0], a[1][1], a[2][2], a[1][2], a[0][2], a[0][1]],
            p,
            q,
        }
    }
}

impl<L: Lane> PrincipalHessian<L> {
    /// Returns the change of P for a change `d` of F, both in the principal frame (Uᵀ d V), as columns.
    #[inline(always)]
    pub fn times(&self, d: &LaneMat3<L>) -> LaneMat3<L> {
        let [xx, yy, zz, yz, xz, xy] = self.a;
        let along = [d[0][0], d[1][1], d[2][2]];
        let diagonal = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].map(|row| dot(row, along));
        std::array::from_fn(|j| {
            std::array::from_fn(|i| match i == j {
                true => diagonal[i],
                false => self.p[3 - i - j] * d[j][i] + self.q[3 - i - j] * d[i][j],
            })
        })
    }

    /// Returns the block between two nodes with the gradients `x` and `y` in the frame of V (Vᵀ g),
    /// as columns.
    #[inline(always)]
    pub fn block(&self, x: LaneVec3<L>, y: LaneVec3<L>) -> LaneMat3<L> {
        let m: LaneMat3<L> = std::array::from_fn(|k| {
            std::array::from_fn(|i| match i == k {
                true => {
                    let (j, l) = ((i + 1) % 3, (i + 2) % 3);
                    self.a[i] * x[i] * y[i] + self.p[l] * x[j] * y[j] + self.p[j] * x[l] * y[l]
                }
                false => self.a[6 - i - k] * x[i] * y[k] + self.q[3 - i - k] * x[k] * y[i],
            })
        });
        // U m Uᵀ.
        let um = m.map(|column| times(&self.u, column));
        let u = &self.u;
        std::array::from_fn(|j| {
            std::array::from_fn(|i| um[0][i] * u[0][j] + um[1][i] * u[1][j] + um[2][i] * u[2][j])
        })
    }
}
