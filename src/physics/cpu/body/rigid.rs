//! Accessors of the rigid parts of a body.

use super::CpuBody;
use super::force_assembly::ForceSources;
use crate::physics::cpu::external_loads::ExternalLoads;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::rigid::pose::{DegreesOfFreedom, PROXY_NODES, Pose, RigidGroup};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::zero;
use glam::DVec3;

impl<T: Real> CpuBody<T> {
    /// Updates the degrees of freedom of rigid bodies, some of whose nodes are fixed.
    pub(in crate::physics::cpu) fn update_freedoms(&mut self, stays: &[bool]) {
        let Some(newton) = &mut self.newton else {
            return;
        };
        let (rigid, v) = (&mut newton.rigid, &mut self.state.v);
        for b in 0..rigid.bodies.len() {
            let before = rigid.bodies[b].freedom;
            let body = &rigid.bodies[b];
            let slots = || body.nodes.clone().chain(body.inner.clone());
            let held: Vec<usize> = slots()
                .filter(|i| stays.get(self.node_order[*i] as usize).is_some_and(|s| *s))
                .collect();
            rigid.set_constraints(b, held.into_iter());
            let body = &rigid.bodies[b];
            let free = body.freedom != DegreesOfFreedom::Fixed;
            rigid.targets[b] = None;
            let share = T::ONE / T::from_f64(body.mass / PROXY_NODES as f64);
            for i in body.nodes.clone() {
                self.free_mask[i] = if free { T::ONE } else { T::ZERO };
                let carries = free && body.proxy_nodes().contains(&i);
                self.inverse_masses[i] = if carries { share } else { T::ZERO };
            }
            if before != body.freedom {
                let momentum = rigid.momentum(b, v);
                rigid.set_momentum(b, momentum, v);
            } else if !free {
                for i in body.nodes.clone().chain(body.inner.clone()) {
                    v[i] = zero();
                }
            } else {
                rigid.write_velocities(b, true, v);
            }
        }
    }

    /// Moves rigid bodies with their constrained nodes: at once, or `gradually` in the next step up
    /// to the first collision.
    pub(in crate::physics::cpu) fn apply_constraints(&mut self, gradually: bool) {
        let Some(newton) = &mut self.newton else {
            return;
        };
        let rigid = &mut newton.rigid;
        if rigid.is_empty() {
            return;
        }
        let mut held: Vec<Vec<(usize, DVec3)>> = vec![Vec::new(); rigid.bodies.len()];
        let wanted = self.attachments.iter().filter_map(|a| match a {
            NodeConstraint::Fixed { node, place } => Some((*node as usize, Some(*place))),
            // Nodes of rigid bodies have no prescribed motion.
            NodeConstraint::Prescribed { .. } | NodeConstraint::Spring { .. } => None,
        });
        let pinned = (0..self.pinned.len()).filter(|v| self.pinned[*v]);
        let mut moves = false;
        for (v, place) in wanted.chain(pinned.map(|v| (v, None))) {
            let slot = self.engine_index[v] as usize;
            let Some(b) = rigid.body_of(slot) else {
                continue;
            };
            moves |= place.is_some();
            let u = match place {
                Some(place) => (place - self.rest[v]) / self.units.length,
                None => rigid.displacement(slot, &rigid.now[b]),
            };
            held[b].push((slot, u));
        }
        if !moves {
            return;
        }
        for (b, held) in held.iter().enumerate().filter(|(_, held)| !held.is_empty()) {
            let pose = rigid.pose_from_constraints(b, held);
            if gradually {
                rigid.targets[b] = Some(pose);
                continue;
            }
            rigid.now[b] = pose;
            let momentum = rigid.momentum(b, &self.state.v);
            rigid.set_momentum(b, momentum, &mut self.state.v);
        }
        rigid.write_nodes(&rigid.now, &mut self.state.u);
    }

    /// Fits rigid bodies to the positions (m) and velocities (m/s) of their nodes.
    pub(in crate::physics::cpu) fn fit_rigid_bodies(
        &mut self,
        positions: &[DVec3],
        velocities: &[DVec3],
    ) {
        let Some(newton) = &mut self.newton else {
            return;
        };
        let (order, units) = (&self.node_order, self.units);
        let of = |i: usize| {
            let v = order[i] as usize;
            (
                positions[v] / units.length,
                velocities[v] / units.velocity(),
            )
        };
        let (u, v) = (&mut self.state.u, &mut self.state.v);
        newton.rigid.fit_state(of, u, v);
    }

    /// Returns the force of the rest of the body on each of its rigid bodies at the current state,
    /// from contact and the surrounding soft tissue: the force, N, and its moment about the centre
    /// of mass, N·m.
    pub fn rigid_forces(&self) -> Vec<[DVec3; 2]> {
        let Some(newton) = &self.newton else {
            return Vec::new();
        };
        let rigid = &newton.rigid;
        if rigid.is_empty() {
            return Vec::new();
        }
        let mut forces = vec![zero(); self.engine_index.len()];
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &ExternalLoads::empty(self.engine_index.len()),
            terms: &self.terms,
        };
        let at = StateRef {
            u: &self.state.u,
            v: &self.state.v,
        };
        self.plan.in_pool(|| sources.forces(at, &mut forces));
        let units = [self.units.force(), self.units.energy()];
        let of = |(body, pose): (&RigidGroup, &Pose)| {
            let mut sum = [DVec3::ZERO; 2];
            // The last nodes are the proxies, on which target springs act.
            let own = body.nodes.start..body.nodes.end - PROXY_NODES;
            for (i, f) in own.clone().zip(&forces[own]) {
                let f = to_dvec(*f);
                sum[0] += f;
                sum[1] += (pose.rotation * rigid.lever_arms[i - rigid.first]).cross(f);
            }
            [sum[0] * units[0], sum[1] * units[1]]
        };
        rigid.bodies.iter().zip(&rigid.now).map(of).collect()
    }

    /// Writes the positions (m) of the nodes of rigid bodies, exact from their poses.
    pub(in crate::physics::cpu) fn write_exact_positions(&self, positions: &mut [DVec3]) {
        let Some(newton) = &self.newton else {
            return;
        };
        let rigid = &newton.rigid;
        for (b, body) in rigid.bodies.iter().enumerate() {
            for i in body.nodes.clone().chain(body.inner.clone()) {
                let v = self.node_order[i] as usize;
                if let Some(x) = positions.get_mut(v) {
                    let moved = rigid.displacement(i, &rigid.now[b]);
                    *x = self.rest[v] + moved * self.units.length;
                }
            }
        }
    }

    /// Returns the number of nodes in the plan: all except those inside rigid bodies.
    #[cfg(test)]
    pub(in crate::physics::cpu) fn active(&self) -> usize {
        self.plan.nodes()
    }
}
