//! Derivatives of the stiffness-proportional damping of elements: of y·D(u) w, D = β K⁺, by the
//! displacements u and by the material, where K⁺ is the projected Hessian.
//!
//! At each quadrature point it is β A : H⁺(F) : B, with the gradients A of y and B of w. In the principal frame
//! of F = U Σ Vᵀ, H⁺ depends on Σ and the material only; its derivatives by these are central differences, exact
//! to about 1e-8 away from states where an eigenvalue changes its sign. The frame turns with F: for D = Uᵀ dF V,
//!
//! - (Uᵀ dU)_ij = (D_ij + D_ji) / 2(σ_j − σ_i) + (D_ij − D_ji) / 2(σ_i + σ_j),
//! - (Vᵀ dV)_ij = (D_ij + D_ji) / 2(σ_j − σ_i) − (D_ij − D_ji) / 2(σ_i + σ_j).

use super::batch::{LaneMat3, LaneVec3, TetBatch, TetPoint, dot, times};
use super::element_batch::{Counted, ElementBatch, ElementSources};
use super::quadratic_batch::QuadraticBatch;
use super::svd::{MIN_TWIST_DENOMINATOR, PrincipalHessian, Svd};
use crate::parallel;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::{V4, add, zero};
use crate::physics::{ConstitutiveModel, DiscreteModel, LocalUnits};

/// Step of the differences by the stretches, and by the Lamé parameters over μ. So small that hardly an
/// eigenvalue changes its sign within a step.
const STEP: f64 = 1e-7;

/// Least difference of two stretches that divides the derivative by a turn of their axes. Closer ones are moved
/// this far apart: the quotient is then off its limit by about the square.
const LEAST_APART: f64 = 1e-5;

/// Pairs of principal axes; the third axis of each is its place in the list.
const AXIS_PAIRS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// A vector of every slot, or of the nodes of a batch.
type Vectors<'a> = &'a [V4<f64>];

/// Derivatives of y·D(u) w.
#[derive(Clone, Debug, Default)]
pub(in crate::physics::cpu) struct DampingDerivatives {
    /// By the displacement of every slot, local units.
    pub by_position: Vec<V4<f64>>,
    /// By the Lamé parameters of every element as they enter the energy, Pa.
    pub by_lame: Vec<[f64; 2]>,
}

/// Returns the derivatives of y·D(u) w, with `at` = [u, w], for each y and the elements of `model`, whose node
/// `v` is the engine's `engine_index[v]`. Elements with averaged nodal volumes have none.
pub(in crate::physics::cpu) fn damping_derivatives(
    model: &DiscreteModel,
    (engine_index, units): (&[u32], &LocalUnits),
    at: [Vectors<'_>; 2],
    all: &[Vectors<'_>],
) -> Vec<DampingDerivatives> {
    let count = model.elements().map_or(0, |elements| elements.tets.len());
    let none = || DampingDerivatives {
        by_position: vec![zero(); at[0].len()],
        by_lame: vec![[0.0; 2]; count],
    };
    let mut found: Vec<DampingDerivatives> = all.iter().map(|_| none()).collect();
    let Some(elements) = model.elements() else {
        return found;
    };
    let damping = model.damping_time / units.time;
    let sources = ElementSources {
        elements,
        units,
        engine_index,
    };
    match elements.order() {
        1 => add_batches::<TetBatch<f64>>(&sources, damping, (at, all), &mut found),
        _ => add_batches::<QuadraticBatch<f64>>(&sources, damping, (at, all), &mut found),
    }
    found
}

/// Derivatives of one y of up to four elements.
struct FourDerivatives {
    /// By the displacements of the nodes of each element.
    by_position: Vec<V4<f64>>,
    by_lame: [[f64; 2]; 4],
}

fn add_batches<B: ElementBatch<f64>>(
    sources: &ElementSources<'_>,
    damping: f64,
    (at, all): ([Vectors<'_>; 2], &[Vectors<'_>]),
    found: &mut [DampingDerivatives],
) where
    B::Item: Send + Sync,
{
    let sorted = B::sorted(sources);
    let batches: Vec<&[B::Item]> = sorted.chunks(4).collect();
    let of_batches = parallel::map_coarse(batches.len(), |n| {
        of_four::<B>(batches[n], (sources, damping), at, all)
    });
    for (four, of_four) in batches.iter().zip(of_batches) {
        for (found, own) in found.iter_mut().zip(of_four) {
            let nodes = four.iter().flat_map(|item| B::nodes(item));
            for (v, g) in nodes.zip(own.by_position) {
                let to = &mut found.by_position[*v as usize];
                *to = add(*to, g);
            }
            for (item, lame) in four.iter().zip(own.by_lame) {
                found.by_lame[B::element(item)] = lame;
            }
        }
    }
}

/// Returns the derivatives of each y of `all` for up to four elements.
fn of_four<B: ElementBatch<f64>>(
    four: &[B::Item],
    (sources, damping): (&ElementSources<'_>, f64),
    at: [Vectors<'_>; 2],
    all: &[Vectors<'_>],
) -> Vec<FourDerivatives> {
    let elements = sources.elements;
    let nodes: Vec<&[u32]> = four.iter().map(B::nodes).collect();
    let count = nodes[0].len();
    // Elements of a batch may share nodes, which are apart in local arrays.
    let local = |all: Vectors<'_>| -> Vec<V4<f64>> {
        let own = nodes
            .iter()
            .flat_map(|n| n.iter().map(|v| all[*v as usize]));
        own.collect()
    };
    let fields: Vec<Vec<V4<f64>>> = at.iter().chain(all).map(|of| local(of)).collect();
    let own: Vec<Counted<B::Item>> = four
        .iter()
        .enumerate()
        .map(|(l, item)| (B::renumbered(item, (l * count) as u32), true))
        .collect();
    let mut by_position = vec![vec![zero(); count * four.len()]; all.len()];
    let mut by_lame = vec![[[0.0; 4]; 2]; all.len()];
    let of_point = |point: &TetPoint<f64>, gradients: &[LaneMat3<_>], stresses: &mut [_]| {
        let [u, w, ys @ ..] = gradients else {
            return;
        };
        let slopes = PointSlopes::new(point, elements.law, u);
        for ((y, stress), by_lame) in ys.iter().zip(stresses).zip(&mut by_lame) {
            let (by_gradient, by_material) = slopes.of_product(y, w);
            // The batch distributes −P.
            *stress = by_gradient.map(|column| column.map(|x| Real::splat(-damping) * x));
            for (sums, by) in by_lame.iter_mut().zip(by_material) {
                for (sum, by) in sums.iter_mut().zip(f64::array(by)) {
                    *sum += damping * by;
                }
            }
        }
    };
    B::new(&own, sources, 0).distribute(&fields, of_point, &mut by_position);
    let all = by_position.into_iter().zip(by_lame);
    all.map(|(by_position, by_lame)| {
        let of_lane = |l: usize| {
            let element = four.get(l).map(|item| &elements.tets[B::element(item)]);
            let mu = element.map_or(1.0, |element| element.lame_parameters[0]);
            by_lame.map(|by| by[l] / mu)
        };
        FourDerivatives {
            by_position,
            by_lame: std::array::from_fn(of_lane),
        }
    })
    .collect()
}

/// The projected Hessian of a quadrature point, and those whose differences are its derivatives.
struct PointSlopes<L> {
    svd: Svd<L>,
    hessian: PrincipalHessian<L>,
    /// With each stretch larger and smaller by [`STEP`].
    by_stretch: [[PrincipalHessian<L>; 2]; 3],
    /// With each Lamé parameter larger and smaller by [`STEP`] times μ.
    by_lame: [[PrincipalHessian<L>; 2]; 2],
    /// For each pair of axes, with stretches that are apart, and σ_j − σ_i.
    apart: [(PrincipalHessian<L>, L); 3],
}

impl<L: Lane> PointSlopes<L> {
    /// Creates those at the displacement gradient `g`.
    fn new<T: Real<Lanes = L>>(
        point: &TetPoint<T>,
        law: ConstitutiveModel,
        g: &LaneMat3<L>,
    ) -> PointSlopes<L> {
        let (svd, zero) = (Svd::new(g), L::splat(0.0));
        let hessian_at = |svd: &Svd<L>, lame| svd.curvature(law, lame, zero, true);
        let hessian = hessian_at(&svd, point.lame);
        let steps = [STEP, -STEP].map(L::splat);
        let by_stretch = |k: usize| {
            steps.map(|step| {
                let by = std::array::from_fn(|i| if i == k { step } else { zero });
                hessian_at(&svd.stretched(by), point.lame)
            })
        };
        let by_lame = |k: usize| {
            steps.map(|step| {
                let mut lame = point.lame;
                lame[k] = lame[k] + step * point.lame[0];
                hessian_at(&svd, lame)
            })
        };
        let apart = |[i, j]: [usize; 2]| {
            let (least, own) = (L::splat(LEAST_APART), svd.sigma[j] - svd.sigma[i]);
            if !least.any_above(-own) {
                return (hessian, own);
            }
            // Stretches descend.
            let apart = -(-own).max(least);
            let half = L::splat(0.5) * (apart - own);
            let mut by = [zero; 3];
            (by[i], by[j]) = (-half, half);
            (hessian_at(&svd.stretched(by), point.lame), apart)
        };
        PointSlopes {
            hessian,
            by_stretch: std::array::from_fn(by_stretch),
            by_lame: std::array::from_fn(by_lame),
            apart: AXIS_PAIRS.map(apart),
            svd,
        }
    }

    /// Returns the derivatives of A : H⁺ : B by F, and by the Lamé parameters over μ.
    fn of_product(&self, a: &LaneMat3<L>, b: &LaneMat3<L>) -> (LaneMat3<L>, [L; 2]) {
        let Svd { u, v, sigma, .. } = &self.svd;
        let principal = |m: &LaneMat3<L>| -> LaneMat3<L> {
            std::array::from_fn(|j| {
                let column = times(m, v[j]);
                std::array::from_fn(|i| dot(u[i], column))
            })
        };
        let (x, y) = (principal(a), principal(b));
        let half_over_step = L::splat(0.5 / STEP);
        let difference = |[up, down]: &[PrincipalHessian<L>; 2]| {
            half_over_step * (product(&x, &up.times(&y)) - product(&x, &down.times(&y)))
        };
        let (hx, hy) = (self.hessian.times(&x), self.hessian.times(&y));
        let mut slopes = [[L::splat(0.0); 3]; 3];
        for (k, own) in self.by_stretch.iter().enumerate() {
            slopes[k][k] = difference(own);
        }
        for ([i, j], (apart, distance)) in AXIS_PAIRS.into_iter().zip(&self.apart) {
            let half = L::splat(0.5);
            let by_turns = |hx: &LaneMat3<L>, hy: &LaneMat3<L>| {
                let ([xu, xv], [yu, yv]) = (turns(&x, hy, [i, j]), turns(&y, hx, [i, j]));
                [xu + yu, xv + yv]
            };
            let [by_u, by_v] = by_turns(&apart.times(&x), &apart.times(&y));
            let symmetric = half * (by_u + by_v) / *distance;
            let [by_u, by_v] = by_turns(&hx, &hy);
            let sum = (sigma[i] + sigma[j]).max(L::splat(MIN_TWIST_DENOMINATOR));
            let skew = half * (by_u - by_v) / sum;
            slopes[j][i] = symmetric + skew;
            slopes[i][j] = symmetric - skew;
        }
        (
            from_principal(u, &slopes, v),
            std::array::from_fn(|k| difference(&self.by_lame[k])),
        )
    }
}

/// Returns a : b.
#[inline(always)]
fn product<L: Lane>(a: &LaneMat3<L>, b: &LaneMat3<L>) -> L {
    dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2])
}

/// Returns U m Vᵀ.
#[inline(always)]
fn from_principal<L: Lane>(u: &LaneMat3<L>, m: &LaneMat3<L>, v: &[LaneVec3<L>; 3]) -> LaneMat3<L> {
    let um = m.map(|column| times(u, column));
    std::array::from_fn(|j| {
        std::array::from_fn(|i| um[0][i] * v[0][j] + um[1][i] * v[1][j] + um[2][i] * v[2][j])
    })
}

/// Returns the derivatives of x : z, with x = Uᵀ A V, by the turns of the axes `i` and `j` of U and of V: by the
/// entries ij of Uᵀ dU and of Vᵀ dV.
#[inline(always)]
fn turns<L: Lane>(x: &LaneMat3<L>, z: &LaneMat3<L>, [i, j]: [usize; 2]) -> [L; 2] {
    let of_u = |c: usize| x[c][i] * z[c][j] - x[c][j] * z[c][i];
    let of_v = |r: usize| x[i][r] * z[j][r] - x[j][r] * z[i][r];
    [of_u(0) + of_u(1) + of_u(2), of_v(0) + of_v(1) + of_v(2)]
}
