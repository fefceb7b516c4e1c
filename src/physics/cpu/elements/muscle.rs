//! Muscle term of the energy: Ψ = ½ a T |F m|². Its Hessian is constant and isotropic.
//!
//! With s_i = ∇N_i·m of the nodal shape functions, F m = m + Σ u_i s_i. Summed over the quadrature
//! points of all elements ([`FibrePoint`]) and up to a constant, E = a (Σ b_i·u_i + ½ Σ k_ij u_i·u_j),
//! b_i = Σ V T s_i m, k_ij = Σ V T s_i s_j. The rows of k sum to zero, so products use differences of
//! displacements, in which translations cancel.

use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, add, add_scaled, dot_f64, from_metres, scale, sub, zero};
use crate::physics::loads::fibre_points::FibrePoint;
use crate::physics::{DiscreteModel, LocalUnits, Muscle};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::ops::Range;

/// Nodes of a muscle in one chunk, ascending, with their matrix rows.
#[derive(Clone, Debug, Default)]
struct Rows<T> {
    first: usize,
    nodes: Vec<u32>,
    starts: Vec<u32>,
    columns: Vec<u32>,
    /// k_ij, i ≠ j.
    coupling: Vec<T>,
    /// b_i.
    linear_forces: Vec<V4<T>>,
}

/// A muscle on the nodes of a body, in the engine's order and units.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct MuscleTerm<T> {
    chunks: Vec<Rows<T>>,
    /// Index of the amplitude that is the activation.
    level: usize,
    activation: T,
    /// h² a at the last linearisation.
    scale: T,
}

impl<T: Real> MuscleTerm<T> {
    /// Creates the term for `muscle` of `network` with the tetrahedra `tets` (in a body of order 2 the
    /// pieces of its elements), activated by the amplitude of index `level`; the activation is
    /// initially 0.
    pub fn new(
        muscle: &Muscle,
        level: usize,
        (network, tets): (&DiscreteModel, &[[u32; 4]]),
        (place, units, plan): (&[u32], LocalUnits, &Partition),
    ) -> MuscleTerm<T> {
        let mut rows: BTreeMap<u32, (DVec3, BTreeMap<u32, f64>)> = BTreeMap::new();
        let strength = |point: &FibrePoint| point.volume * muscle.tension / units.energy();
        muscle.for_each_element((network, tets), units.length, |nodes, points| {
            for (n, i) in nodes.iter().enumerate() {
                let (pull, ties) = rows.entry(place[*i as usize]).or_default();
                for point in points {
                    *pull += strength(point) * point.slopes[n] * point.direction;
                }
                for (k, j) in nodes.iter().enumerate().filter(|(k, _)| *k != n) {
                    let products = points
                        .iter()
                        .map(|point| strength(point) * point.slopes[n] * point.slopes[k]);
                    *ties.entry(place[*j as usize]).or_default() += products.sum::<f64>();
                }
            }
        });
        let chunk = |nodes: Range<usize>| {
            let mut own = Rows {
                first: nodes.start,
                starts: vec![0],
                ..Rows::default()
            };
            for (i, (pull, ties)) in rows.range(nodes.start as u32..nodes.end as u32) {
                own.nodes.push(*i);
                own.linear_forces.push(from_metres(*pull, 1.0));
                for (j, tie) in ties {
                    own.columns.push(*j);
                    own.coupling.push(T::from_f64(*tie));
                }
                own.starts.push(own.columns.len() as u32);
            }
            own
        };
        MuscleTerm {
            chunks: (0..plan.chunks()).map(|c| chunk(plan.range(c))).collect(),
            level,
            activation: T::ZERO,
            scale: T::ZERO,
        }
    }
}

impl<T: Real> Rows<T> {
    /// Iterates over the nodes: index within the muscle, node, and range of its couplings.
    fn each(&self) -> impl Iterator<Item = (usize, usize, Range<usize>)> {
        let spans = self.starts.windows(2);
        let spans = spans.map(|w| w[0] as usize..w[1] as usize);
        let nodes = self.nodes.iter().map(|i| *i as usize);
        nodes
            .zip(spans)
            .enumerate()
            .map(|(n, (i, span))| (n, i, span))
    }

    /// Returns Σ_j k_ij (p_j − p_i).
    #[inline]
    fn coupling_product(&self, i: usize, span: Range<usize>, p: &[V4<T>]) -> V4<T> {
        let mut sum = zero();
        for (j, tie) in self.columns[span.clone()].iter().zip(&self.coupling[span]) {
            sum = add_scaled(sum, *tie, sub(p[*j as usize], p[i]));
        }
        sum
    }

    /// Returns Σ u_i·(b_i + ½ Σ_j k_ij u_j) and passes the force on each node at full activation to
    /// `take`.
    #[inline]
    fn evaluate(&self, u: &[V4<T>], mut take: impl FnMut(usize, V4<T>)) -> f64 {
        let mut energy = 0.0;
        for (n, i, span) in self.each() {
            let (pull, tied) = (self.linear_forces[n], self.coupling_product(i, span, u));
            energy += dot_f64(u[i], add_scaled(pull, T::HALF, tied));
            take(i, sub(zero(), add(pull, tied)));
        }
        energy
    }
}

impl<T: Real> Term<T> for MuscleTerm<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        self.elastic_forces(chunk, at.u, f)
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        if self.activation == T::ZERO {
            return 0.0;
        }
        let rows = &self.chunks[chunk];
        let energy = rows.evaluate(u, |i, force| {
            let f = &mut f[i - rows.first];
            *f = add_scaled(*f, self.activation, force);
        });
        self.activation.to_f64() * energy
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        match self.activation == T::ZERO {
            true => 0.0,
            false => self.activation.to_f64() * self.chunks[chunk].evaluate(u, |_, _| {}),
        }
    }

    fn set_amplitudes(&mut self, levels: &[f64]) {
        self.activation = T::from_f64(levels.get(self.level).copied().unwrap_or(0.0));
    }

    fn linearise(
        &mut self,
        _: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        self.scale = h * h * self.activation;
        if self.activation == T::ZERO {
            return;
        }
        for rows in &self.chunks {
            for (_, i, span) in rows.each() {
                let mut diagonal_entry = T::ZERO;
                rows.coupling[span.clone()]
                    .iter()
                    .for_each(|tie| diagonal_entry -= *tie);
                for d in &mut share.diagonal[i][..3] {
                    *d += self.scale * diagonal_entry;
                }
                let kv = scale(self.activation, rows.coupling_product(i, span, at.v));
                share.stiffness_velocity[i] = sub(share.stiffness_velocity[i], kv);
            }
        }
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        if self.scale == T::ZERO {
            return;
        }
        let rows = &self.chunks[chunk];
        for (_, i, span) in rows.each() {
            let y = &mut y[i - rows.first];
            *y = add_scaled(*y, self.scale, rows.coupling_product(i, span, p));
        }
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for rows in &self.chunks {
            for (_, i, span) in rows.each() {
                for (j, tie) in rows.columns[span.clone()].iter().zip(&rows.coupling[span]) {
                    if i < *j as usize {
                        let block =
                            DMat3::from_diagonal(DVec3::splat((self.scale * *tie).to_f64()));
                        visit([i as u32, *j], &block);
                    }
                }
            }
        }
    }
}
