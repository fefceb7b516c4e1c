//! External loads: gravity, forces, pressures and target springs.

use super::node_constraints::NodeConstraint;
use super::partition::Partition;
use super::pressure::Pressure;
use super::scalar::Real;
use super::vectors::{V4, add, add_scaled, from_metres, scale, sub, zero};
use crate::physics::LocalUnits;
use glam::DVec3;

/// A target spring, in local units.
#[derive(Clone, Copy, Debug)]
struct NodeTargetSpring<T> {
    node: usize,
    /// From the node's rest position to the target.
    to: V4<T>,
    stiffness: T,
    limit: T,
}

/// All external loads of a body, in local units and the engine's order.
#[derive(Clone, Debug)]
pub struct ExternalLoads<T> {
    gravity: V4<T>,
    forces: Vec<V4<T>>,
    has_forces: bool,
    target_springs: Vec<NodeTargetSpring<T>>,
    pressures: Vec<Pressure<T>>,
}

impl<T: Real> ExternalLoads<T> {
    /// Creates empty loads for `nodes` nodes.
    pub fn empty(nodes: usize) -> ExternalLoads<T> {
        ExternalLoads {
            gravity: zero(),
            forces: vec![zero(); nodes],
            has_forces: false,
            target_springs: Vec::new(),
            pressures: Vec::new(),
        }
    }

    pub(super) fn add_pressure(&mut self, pressure: Pressure<T>) {
        self.pressures.push(pressure);
    }

    /// Sets the pressures from the amplitudes.
    pub fn set_levels(&mut self, levels: &[f64]) {
        self.pressures
            .iter_mut()
            .for_each(|p| p.set_amplitude(levels));
    }

    /// Sets gravity, m/s².
    pub fn set_gravity(&mut self, gravity: DVec3, units: &LocalUnits) {
        self.gravity = from_metres(gravity, units.acceleration());
    }

    /// Sets the force on every node, N, in the file's order.
    pub fn set_forces(&mut self, forces: &[DVec3], order: &[u32], units: &LocalUnits) {
        self.has_forces = forces.iter().any(|f| *f != DVec3::ZERO);
        for (f, v) in self.forces.iter_mut().zip(order) {
            *f = from_metres(forces[*v as usize], units.force());
        }
    }

    /// Sets the target springs: the [`NodeConstraint::Spring`] entries of `attachments`. `place` is
    /// the engine's index of every node, `rest` the rest positions in the file's order, m.
    pub fn set_target_springs(
        &mut self,
        attachments: &[NodeConstraint],
        place: &[u32],
        rest: &[DVec3],
        units: &LocalUnits,
    ) {
        self.target_springs.clear();
        for a in attachments {
            if let NodeConstraint::Spring {
                node,
                target,
                stiffness,
                limit,
            } = *a
            {
                self.target_springs.push(NodeTargetSpring {
                    node: place[node as usize] as usize,
                    to: from_metres(target - rest[node as usize], units.length),
                    stiffness: T::from_f64(stiffness / units.stiffness()),
                    limit: T::from_f64((limit / units.force()).min(1e30)),
                });
            }
        }
        self.target_springs.sort_by_key(|d| d.node);
    }

    /// Writes the loads on the nodes of a chunk into `f`, with the target springs at the
    /// displacements `u`.
    pub fn write_forces(
        &self,
        plan: &Partition,
        chunk: usize,
        masses: &[T],
        u: &[V4<T>],
        f: &mut [V4<T>],
    ) {
        let nodes = plan.range(chunk);
        for (f, m) in f.iter_mut().zip(&masses[nodes.clone()]) {
            *f = scale(*m, self.gravity);
        }
        if self.has_forces {
            for (f, e) in f.iter_mut().zip(&self.forces[nodes.clone()]) {
                *f = add(*f, *e);
            }
        }
        let from = self
            .target_springs
            .partition_point(|d| d.node < nodes.start);
        let mine = self.target_springs[from..].iter();
        for d in mine.take_while(|d| d.node < nodes.end) {
            let i = d.node - nodes.start;
            f[i] = add(f[i], d.spring_force(u));
        }
        for pressure in &self.pressures {
            pressure.add_forces(chunk, nodes.start, u, f);
        }
    }
}

impl<T: Real> ExternalLoads<T> {
    /// Whether any load depends on the displacements.
    pub fn has_tangent(&self) -> bool {
        !(self.target_springs.is_empty() && self.pressures.is_empty())
    }

    /// Subtracts (∂f/∂u)ᵀ y from `out`, with f the loads at the displacements `u`.
    pub fn subtract_transposed_tangent(
        &self,
        plan: &Partition,
        (u, y): (&[V4<T>], &[V4<T>]),
        out: &mut [V4<T>],
    ) {
        for spring in &self.target_springs {
            let i = spring.node;
            out[i] = add(out[i], spring.stiffness_product(u, y[i]));
        }
        for pressure in &self.pressures {
            pressure.subtract_transposed_tangent(plan, (u, y), out);
        }
    }

    /// Adds the forces of the pressures alone at the displacements `u`, for amplitudes other than
    /// the present ones.
    pub fn add_pressures_at(&self, plan: &Partition, levels: &[f64], u: &[V4<T>], f: &mut [V4<T>]) {
        for pressure in &self.pressures {
            let mut other = pressure.clone();
            other.set_amplitude(levels);
            for chunk in 0..plan.chunks() {
                let own = plan.range(chunk);
                other.add_forces(chunk, own.start, u, &mut f[own]);
            }
        }
    }

    /// Returns the power of the loads on a chunk's nodes, which move with `v`.
    pub fn power(
        &self,
        plan: &Partition,
        chunk: usize,
        masses: &[T],
        u: &[V4<T>],
        v: &[V4<T>],
    ) -> f64 {
        // Node by node, without allocation.
        let nodes = plan.range(chunk);
        let g = self.gravity;
        let mut sum = 0.0;
        for ((v, m), f) in v
            .iter()
            .zip(&masses[nodes.clone()])
            .zip(&self.forces[nodes.clone()])
        {
            let f = add(scale(*m, g), *f);
            sum += (f[0] * v[0] + f[1] * v[1] + f[2] * v[2]).to_f64();
        }
        let from = self
            .target_springs
            .partition_point(|d| d.node < nodes.start);
        let mine = self.target_springs[from..].iter();
        for d in mine.take_while(|d| d.node < nodes.end) {
            let (f, v) = (d.spring_force(u), v[d.node - nodes.start]);
            sum += (f[0] * v[0] + f[1] * v[1] + f[2] * v[2]).to_f64();
        }
        let pressures = self.pressures.iter();
        sum + pressures
            .map(|p| p.power(chunk, nodes.start, u, v))
            .sum::<f64>()
    }
}

impl<T: Real> NodeTargetSpring<T> {
    /// Returns minus the derivative of the force at the displacements `u`, times p.
    fn stiffness_product(&self, u: &[V4<T>], p: V4<T>) -> V4<T> {
        let pull = scale(self.stiffness, sub(self.to, u[self.node]));
        let square = pull[0] * pull[0] + pull[1] * pull[1] + pull[2] * pull[2];
        if square.sqrt() <= self.limit {
            return scale(self.stiffness, p);
        }
        // At its limit a spring resists rotation only.
        let along = (pull[0] * p[0] + pull[1] * p[1] + pull[2] * p[2]) / square;
        let by = self.stiffness * self.limit / square.sqrt();
        scale(by, add_scaled(p, -along, pull))
    }

    /// Returns the force at the displacements `u`.
    fn spring_force(&self, u: &[V4<T>]) -> V4<T> {
        let pull = scale(self.stiffness, sub(self.to, u[self.node]));
        let strength = (pull[0] * pull[0] + pull[1] * pull[1] + pull[2] * pull[2]).sqrt();
        match strength > self.limit {
            true => scale(self.limit / strength, pull),
            false => pull,
        }
    }
}
