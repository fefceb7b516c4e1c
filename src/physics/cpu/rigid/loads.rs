//! External forces on rigid bodies, transferred to their proxy nodes.

use super::bodies::RigidBodies;
use super::pose::{PROXY_NODES, PROXY_POSITIONS, RigidGroup, inertia_of};
use super::target_springs::RigidTargetSpring;
use crate::physics::LocalUnits;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::outer;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, zero};
use glam::{DMat3, DVec3};

impl RigidBodies {
    /// Whether springs at a node are handled by the rigid target spring term: at interior nodes,
    /// and at all nodes of an isolated body, which may be light. At others they act as at soft
    /// nodes, and as on the GPU.
    pub fn is_target_spring_node(&self, slot: usize) -> bool {
        let body = self.body_of(slot).map(|b| &self.bodies[b]);
        body.is_some_and(|body| body.is_isolated || body.inner.contains(&slot))
    }

    /// Returns the target springs at nodes of rigid bodies. `place` gives slots, `rest` is in m.
    pub fn target_springs(
        &self,
        attachments: &[NodeConstraint],
        (place, rest): (&[u32], &[DVec3]),
        units: &LocalUnits,
    ) -> Vec<RigidTargetSpring> {
        let springs = attachments.iter().filter_map(|a| {
            let NodeConstraint::Spring {
                node,
                target,
                stiffness,
                limit,
            } = *a
            else {
                return None;
            };
            let slot = place[node as usize] as usize;
            if !self.is_target_spring_node(slot) {
                return None;
            }
            let body = &self.bodies[self.body_of(slot)?];
            let arm = body.inverse_inertia_map * self.lever_arms[slot - self.first];
            let first = body.proxy_nodes().start as u32;
            Some(RigidTargetSpring {
                nodes: [first, first + 1, first + 2, first + 3],
                weights: PROXY_POSITIONS.map(|t| (1.0 + t.dot(arm)) / PROXY_NODES as f64),
                target_offset: (target - rest[node as usize]) / units.length,
                stiffness: stiffness / units.stiffness(),
                limit: limit / units.force(),
            })
        });
        springs.collect()
    }

    /// Transfers forces on interior nodes, in the order of the network, to the proxy nodes, which
    /// come last; the forces do not rotate with the body. `order` is the network's index of every
    /// slot.
    pub fn transfer_to_carriers(&self, forces: &mut [DVec3], order: &[u32]) {
        for body in &self.bodies {
            let (mut sum, mut moment) = (DVec3::ZERO, DMat3::ZERO);
            for i in body.inner.clone() {
                let f = std::mem::take(&mut forces[order[i] as usize]);
                sum += f;
                moment += outer(f, self.lever_arms[i - self.first]);
            }
            for (i, share) in body.proxy_nodes().zip(carrier_forces(body, sum, moment)) {
                forces[order[i] as usize] = share;
            }
        }
    }

    /// Returns the forces on the proxy nodes of a body in its pose now that have a sum and a moment
    /// about its pivot.
    pub fn proxy_forces(
        &self,
        b: usize,
        (force, mut moment): (DVec3, DVec3),
    ) -> [(usize, DVec3); PROXY_NODES] {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, _) = body.pivot(pose);
        // The proxy nodes lie around the centre.
        moment -= (pose.rotation * -pivot).cross(force);
        let arm = |i: usize| pose.rotation * self.lever_arms[i - self.first];
        let nodes = body.proxy_nodes();
        let inertia = nodes.fold(DMat3::ZERO, |sum, i| sum + inertia_of(arm(i)));
        let turn = inertia.inverse() * moment;
        std::array::from_fn(|k| {
            let i = body.proxy_nodes().start + k;
            (i, force / PROXY_NODES as f64 + turn.cross(arm(i)))
        })
    }

    /// Transfers the forces on the nodes of a body's surface to its proxy nodes: `f` is that of a
    /// chunk that begins with node `start`.
    pub fn transfer_surface_forces<T: Real>(&self, b: usize, start: usize, f: &mut [V4<T>]) {
        let body = &self.bodies[b];
        let (mut sum, mut moment) = (DVec3::ZERO, DMat3::ZERO);
        for i in body.nodes.start..body.nodes.end - PROXY_NODES {
            let force = &mut f[i - start];
            if force[..3].iter().any(|x| *x != T::ZERO) {
                let one = to_dvec(*force);
                sum += one;
                moment += outer(one, self.lever_arms[i - self.first]);
                *force = zero();
            }
        }
        let shares = carrier_forces(body, sum, moment);
        for (i, share) in body.proxy_nodes().zip(shares) {
            let own = to_dvec(f[i - start]);
            f[i - start] = to_v4(own + share);
        }
    }
}

/// Returns the forces on the proxy nodes equivalent to a force and its sum of f rᵀ, for any affine
/// motion.
fn carrier_forces(body: &RigidGroup, sum: DVec3, moment: DMat3) -> [DVec3; PROXY_NODES] {
    let turned = moment * body.inverse_inertia_map.transpose();
    PROXY_POSITIONS.map(|t| (sum + turned * t) / PROXY_NODES as f64)
}
