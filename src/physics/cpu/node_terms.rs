//! User-defined per-node energy terms on the CPU.

use super::partition::Partition;
use super::scalar::Real;
use super::term::{StateRef, SystemContribution, Term};
use super::vectors::{SymMat3, V4, add, apply_symmetric, from_metres, sub, to_metres};
use crate::physics::{DiscreteModel, LocalUnits, NodeTerm};
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// A [`NodeTerm`] on the nodes of a body, in the engine's order and units, computed in float64.
pub(super) struct NodeTerms<T> {
    term: Arc<dyn NodeTerm>,
    units: LocalUnits,
    first: Vec<usize>,
    /// Rest positions, m, and masses, kg.
    rest: Vec<DVec3>,
    masses: Vec<f64>,
    /// h² times the block of each node, at the last linearisation.
    blocks: Vec<SymMat3<T>>,
}

impl<T: Real> NodeTerms<T> {
    /// Creates the term on the nodes of `network`, in `order` and partitioned by `plan`.
    pub fn new(
        term: Arc<dyn NodeTerm>,
        network: &DiscreteModel,
        (order, units, plan): (&[u32], LocalUnits, &Partition),
    ) -> Self {
        // Nodes inside rigid bodies lie beyond the plan; proxy nodes of rigid bodies are not nodes
        // of the network, and have no mass here.
        let order = &order[..plan.nodes()];
        let rest = |v: &u32| {
            network
                .rest_positions
                .get(*v as usize)
                .copied()
                .unwrap_or_default()
        };
        let mass = |v: &u32| network.masses.get(*v as usize).copied().unwrap_or_default();
        NodeTerms {
            term,
            units,
            first: (0..plan.chunks()).map(|c| plan.range(c).start).collect(),
            rest: order.iter().map(rest).collect(),
            masses: order.iter().map(mass).collect(),
            blocks: vec![[T::ZERO; 8]; order.len()],
        }
    }

    fn place(&self, k: usize, u: V4<T>) -> DVec3 {
        self.rest[k] + to_metres(u, self.units.length)
    }
}

impl<T: Real> Term<T> for NodeTerms<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let first = self.first[chunk];
        let mut energy = 0.0;
        for (i, f) in f.iter_mut().enumerate() {
            let k = first + i;
            let (m, x) = (self.masses[k], self.place(k, at.u[k]));
            *f = add(*f, from_metres(self.term.force(m, x), self.units.force()));
            energy += self.term.energy(m, x);
        }
        energy / self.units.energy()
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        self.forces(chunk, StateRef { u, v: u }, f)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let end = self.first.get(chunk + 1).copied();
        let nodes = self.first[chunk]..end.unwrap_or(self.rest.len());
        let all = nodes.map(|k| self.term.energy(self.masses[k], self.place(k, u[k])));
        all.sum::<f64>() / self.units.energy()
    }

    fn linearise(
        &mut self,
        _: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let stiffness = self.units.stiffness();
        for k in 0..self.rest.len() {
            let x = self.place(k, at.u[k]);
            let block = packed(&(self.term.hessian(self.masses[k], x) * (1.0 / stiffness)));
            let kv = apply_symmetric(&block, at.v[k]);
            share.stiffness_velocity[k] = sub(share.stiffness_velocity[k], kv);
            let of_step = block.map(|b| h * h * b);
            for (all, b) in share.diagonal[k].iter_mut().zip(of_step) {
                *all += b;
            }
            self.blocks[k] = of_step;
        }
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        let first = self.first[chunk];
        for (i, y) in y.iter_mut().enumerate() {
            *y = add(*y, apply_symmetric(&self.blocks[first + i], p[first + i]));
        }
    }

    fn visit_off_diagonal(&self, _: &mut dyn FnMut([u32; 2], &DMat3)) {}
}

fn packed<T: Real>(m: &DMat3) -> SymMat3<T> {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    [x.x, y.y, z.z, x.y, x.z, y.z, 0.0, 0.0].map(T::from_f64)
}
