//! Batches of four ten-node tetrahedra, one per SIMD lane.
//!
//! The gradients of the ten shape functions are combinations of those of the barycentric
//! coordinates: ∇N_i = Σ_a B_ia g_a with B = ∂N/∂L, which depends on the quadrature point only. At
//! each point a ten-node tet is therefore a linear one with the displacements w_a = Σ_i B_ia u_i at
//! its corners: energies and stresses are those of [`TetPoint`], forces and blocks are distributed
//! by B.

use super::batch::{LaneMat3, LaneVec3, TetPoint};
use super::element_batch::{Counted, DampedState, ElementBatch, ElementSources, FourBlocks};
use super::kernels::{NODE_PAIRS, unpack_blocks};
use crate::physics::ConstitutiveModel;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::{V4, add};
use crate::physics::model::quadratic::{
    QUADRATIC_NODES, QUADRATURE, QUADRATURE_POINTS, quadrature_point, shape_gradients,
};
use glam::DVec3;

/// 4 L_a at a quadrature point for the corner a nearest to it, and for the others.
const FOUR_L: [f64; 2] = [4.0 * QUADRATURE[0], 4.0 * QUADRATURE[1]];

/// Four ten-node tetrahedra.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct QuadraticBatch<T: Real> {
    /// Nodes of each tetrahedron: corners, then the middles of [`NODE_PAIRS`], in the engine's order.
    nodes: [[u32; QUADRATIC_NODES]; 4],
    points: [TetPoint<T>; QUADRATURE_POINTS],
}

/// Pairs of nodes of a ten-node tet.
const QUADRATIC_PAIRS: [[usize; 2]; 45] = pairs();

const fn pairs() -> [[usize; 2]; 45] {
    let mut all = [[0; 2]; 45];
    let (mut n, mut a) = (0, 0);
    while a < QUADRATIC_NODES {
        let mut b = a + 1;
        while b < QUADRATIC_NODES {
            all[n] = [a, b];
            (n, b) = (n + 1, b + 1);
        }
        a += 1;
    }
    all
}

/// Returns 4 L_a at a quadrature point.
#[inline(always)]
fn four_l(point: usize, a: usize) -> f64 {
    FOUR_L[usize::from(a != point)]
}

/// Returns the corners on whose barycentric coordinates the shape function of node `i` depends at a
/// quadrature point, with ∂N_i/∂L_a; the second is zero for corners.
#[inline(always)]
fn derivatives(point: usize, i: usize) -> [(usize, f64); 2] {
    match i {
        0..4 => [(i, four_l(point, i) - 1.0), (i, 0.0)],
        _ => {
            let [a, b] = NODE_PAIRS[i - 4];
            [(a, four_l(point, b)), (b, four_l(point, a))]
        }
    }
}

type LaneNodes<L> = [LaneVec3<L>; QUADRATIC_NODES];

impl<T: Real> QuadraticBatch<T> {
    #[inline(always)]
    fn gather(&self, u: &[V4<T>]) -> LaneNodes<T::Lanes> {
        std::array::from_fn(|i| {
            let [x, y, z, _] = T::Lanes::transpose(self.nodes.map(|n| T::lanes(&u[n[i] as usize])));
            [x, y, z]
        })
    }

    /// Returns the displacement gradient at a quadrature point.
    #[inline(always)]
    fn gradient(&self, point: usize, u: &LaneNodes<T::Lanes>) -> LaneMat3<T::Lanes> {
        let mut w: [LaneVec3<T::Lanes>; 4] = std::array::from_fn(|a| {
            let own = T::Lanes::splat(four_l(point, a) - 1.0);
            u[a].map(|u| own * u)
        });
        for (edge, [a, b]) in NODE_PAIRS.into_iter().enumerate() {
            let middle = u[4 + edge];
            let (la, lb) = (four_l(point, a), four_l(point, b));
            for k in 0..3 {
                w[a][k] = w[a][k] + T::Lanes::splat(lb) * middle[k];
                w[b][k] = w[b][k] + T::Lanes::splat(la) * middle[k];
            }
        }
        let [o, corners @ ..] = w;
        self.points[point].gradient(corners.map(|w| std::array::from_fn(|k| w[k] - o[k])))
    }

    /// Adds −P ∇N at a quadrature point, for P times the volume.
    #[inline(always)]
    fn add_forces(
        &self,
        point: usize,
        stress: &LaneMat3<T::Lanes>,
        forces: &mut LaneNodes<T::Lanes>,
    ) {
        let corners = self.points[point].all_gradients().map(|g| {
            let f: LaneVec3<T::Lanes> = std::array::from_fn(|i| {
                -(stress[0][i] * g[0] + stress[1][i] * g[1] + stress[2][i] * g[2])
            });
            f
        });
        for (i, force) in forces.iter_mut().enumerate() {
            for (a, by) in derivatives(point, i) {
                for k in 0..3 {
                    force[k] = force[k] + T::Lanes::splat(by) * corners[a][k];
                }
            }
        }
    }

    #[inline(always)]
    fn scatter<const INNER: bool>(
        &self,
        forces: &LaneNodes<T::Lanes>,
        first: usize,
        out: &mut [V4<T>],
    ) {
        for (i, [x, y, z]) in forces.iter().enumerate() {
            let tets = T::Lanes::transpose([*x, *y, *z, T::Lanes::splat(0.0)]).map(T::array);
            for (nodes, f) in self.nodes.iter().zip(tets) {
                // For nodes before the chunk the subtraction wraps around to an index past its end.
                let place = (nodes[i] as usize).wrapping_sub(first);
                if INNER {
                    out[place] = add(out[place], f);
                } else if let Some(out) = out.get_mut(place) {
                    *out = add(*out, f);
                }
            }
        }
    }
}

/// Returns the 16 blocks of the corners at a quadrature point from those above the diagonal: each
/// row sums to zero, and the blocks below are transposes.
#[inline(always)]
fn complete<L: Lane>(above: &[LaneMat3<L>; 6]) -> [[LaneMat3<L>; 4]; 4] {
    let zero = L::splat(0.0);
    let mut all = [[[[zero; 3]; 3]; 4]; 4];
    for ([a, b], block) in NODE_PAIRS.into_iter().zip(above) {
        for j in 0..3 {
            for i in 0..3 {
                let x = block[j][i];
                all[a][b][j][i] = x;
                all[b][a][i][j] = x;
                all[a][a][j][i] = all[a][a][j][i] - x;
                all[b][b][i][j] = all[b][b][i][j] - x;
            }
        }
    }
    all
}

impl<T: Real> ElementBatch<T> for QuadraticBatch<T> {
    /// The nodes, and the index of the element.
    type Item = ([u32; QUADRATIC_NODES], u32);

    const PAIRS: &'static [[usize; 2]] = &QUADRATIC_PAIRS;

    fn sorted(sources: &ElementSources<'_>) -> Vec<Self::Item> {
        let of_element = |t: usize| {
            let nodes = sources.elements.quadratic_nodes(t)?;
            Some((nodes.map(|v| sources.engine_index[v as usize]), t as u32))
        };
        let count = sources.elements.tets.len();
        let mut sorted: Vec<Self::Item> = (0..count).filter_map(of_element).collect();
        sorted.sort_unstable_by_key(|(nodes, t)| (nodes.iter().min().copied(), *t));
        sorted
    }

    fn nodes(item: &Self::Item) -> &[u32] {
        &item.0
    }

    fn element((_, t): &Self::Item) -> usize {
        *t as usize
    }

    fn renumbered((_, t): &Self::Item, first: u32) -> Self::Item {
        (std::array::from_fn(|k| first + k as u32), *t)
    }

    fn new(own: &[Counted<Self::Item>], sources: &ElementSources<'_>, fill: u32) -> Self {
        let (elements, units) = (sources.elements, sources.units);
        let mut nodes = [[fill; QUADRATIC_NODES]; 4];
        let mut points = [([[[T::ZERO; 4]; 3]; 3], [[T::ZERO; 4]; 2]); QUADRATURE_POINTS];
        for (l, ((engine_nodes, t), _)) in own.iter().enumerate() {
            nodes[l] = *engine_nodes;
            let element = &elements.tets[*t as usize];
            let Some(rest) = elements.quadratic_rest(*t as usize) else {
                continue;
            };
            for (point, (gradients, lame)) in points.iter_mut().enumerate() {
                let Some((shape, determinant)) = shape_gradients(&rest, quadrature_point(point))
                else {
                    continue;
                };
                for (k, g) in barycentric_gradients(point, &shape).into_iter().enumerate() {
                    for (axis, x) in (g * units.length).to_array().into_iter().enumerate() {
                        gradients[k][axis][l] = T::from_f64(x);
                    }
                }
                let volume = determinant / 24.0;
                for (to, modulus) in lame.iter_mut().zip(element.lame_parameters) {
                    to[l] = T::from_f64(modulus * volume / units.energy());
                }
            }
        }
        QuadraticBatch {
            nodes,
            points: points.map(|(gradients, lame)| TetPoint {
                gradients: gradients.map(|g| g.map(|x| T::lanes(&x))),
                lame: lame.map(|l| T::lanes(&l)),
            }),
        }
    }

    #[inline(always)]
    fn energy(&self, law: ConstitutiveModel, u: &[V4<T>]) -> T::Lanes {
        let u = self.gather(u);
        let mut sum = T::Lanes::splat(0.0);
        for (n, point) in self.points.iter().enumerate() {
            sum = sum + point.energy(law, &self.gradient(n, &u));
        }
        sum
    }

    #[inline(always)]
    fn inverted(&self, u: &[V4<T>]) -> bool {
        let u = self.gather(u);
        let mut points = self.points.iter().enumerate();
        points.any(|(n, point)| point.inverted(&self.gradient(n, &u)))
    }

    #[inline(always)]
    fn forces<const INNER: bool, const DAMPED: bool>(
        &self,
        law: ConstitutiveModel,
        (u, v, damping): DampedState<'_, T>,
        _: [T::Lanes; 2],
        first: usize,
        f: &mut [V4<T>],
    ) -> T::Lanes {
        let (zero, at) = (T::Lanes::splat(0.0), self.gather(u));
        let rates = if DAMPED { self.gather(v) } else { at };
        let mut forces = [[zero; 3]; QUADRATIC_NODES];
        let mut sum = zero;
        for (n, point) in self.points.iter().enumerate() {
            let g = self.gradient(n, &at);
            let (mut stress, energy) = point.stress(law, &g, zero);
            if DAMPED {
                let rate = self.gradient(n, &rates);
                let change = point.stress_differential(law, &g, &rate, [zero; 2]);
                for (s, c) in stress
                    .as_flattened_mut()
                    .iter_mut()
                    .zip(change.as_flattened())
                {
                    *s = *s + damping.splat() * *c;
                }
            }
            self.add_forces(n, &stress, &mut forces);
            sum = sum + energy;
        }
        self.scatter::<INNER>(&forces, first, f);
        sum
    }

    #[inline(always)]
    fn blocks(
        &self,
        with: (ConstitutiveModel, bool),
        u: &[V4<T>],
        _: T::Lanes,
        scale: T::Lanes,
        mut emit: impl FnMut(usize, FourBlocks<T>),
    ) {
        let (zero, u) = (T::Lanes::splat(0.0), self.gather(u));
        let corners: [[[LaneMat3<T::Lanes>; 4]; 4]; QUADRATURE_POINTS] = std::array::from_fn(|n| {
            let mut above = [[[zero; 3]; 3]; 6];
            let g = self.gradient(n, &u);
            self.points[n].blocks(with, &g, zero, scale, |pair, block| above[pair] = block);
            complete(&above)
        });
        for (n, [i, j]) in QUADRATIC_PAIRS.into_iter().enumerate() {
            let mut block = [[zero; 3]; 3];
            for (point, corners) in corners.iter().enumerate() {
                for (a, by) in derivatives(point, i) {
                    for (b, also) in derivatives(point, j) {
                        if by == 0.0 || also == 0.0 {
                            continue;
                        }
                        let factor = T::Lanes::splat(by * also);
                        for (sum, x) in block
                            .as_flattened_mut()
                            .iter_mut()
                            .zip(corners[a][b].as_flattened())
                        {
                            *sum = *sum + factor * *x;
                        }
                    }
                }
            }
            emit(n, unpack_blocks::<T>(&block));
        }
    }

    fn distribute(
        &self,
        fields: &[Vec<V4<T>>],
        mut of_point: impl FnMut(&TetPoint<T>, &[LaneMat3<T::Lanes>], &mut [LaneMat3<T::Lanes>]),
        out: &mut [Vec<V4<T>>],
    ) {
        let zero = T::Lanes::splat(0.0);
        let fields: Vec<LaneNodes<T::Lanes>> = fields.iter().map(|u| self.gather(u)).collect();
        let mut forces = vec![[[zero; 3]; QUADRATIC_NODES]; out.len()];
        let mut stresses = vec![[[zero; 3]; 3]; out.len()];
        for (n, point) in self.points.iter().enumerate() {
            let gradients = fields.iter().map(|u| self.gradient(n, u));
            let gradients: Vec<LaneMat3<T::Lanes>> = gradients.collect();
            of_point(point, &gradients, &mut stresses);
            for (stress, forces) in stresses.iter().zip(&mut forces) {
                self.add_forces(n, stress, forces);
            }
        }
        for (forces, out) in forces.iter().zip(out) {
            self.scatter::<true>(forces, 0, out);
        }
    }
}

/// Returns the gradients of the last three barycentric coordinates at a quadrature point from those
/// of the ten shape functions: with G the gradients of the corners' functions, ∇N_a = (4 L_a − 1)
/// ∇L_a.
fn barycentric_gradients(point: usize, shape: &[DVec3; QUADRATIC_NODES]) -> [DVec3; 3] {
    std::array::from_fn(|k| shape[k + 1] / (four_l(point, k + 1) - 1.0))
}
