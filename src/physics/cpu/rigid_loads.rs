//! Forces on rigid bodies from outside: handed to their carriers.

use super::loads::Attachment;
use super::real::Real;
use super::rigid::RigidBodies;
use super::rigid_pose::{CARRIERS, CORNERS, Rigid, narrow, outer, wide};
use super::tethers::Tether;
use super::vectors::{V4, zero};
use crate::physics::Units;
use glam::{DMat3, DVec3};

impl RigidBodies {
    /// Whether springs at a node are such a term: at nodes inside, and at all of a body alone, which
    /// may be light. At others they pull as at soft nodes, and as on the GPU.
    pub fn tethers_at(&self, slot: usize) -> bool {
        let body = self.of(slot).map(|b| &self.bodies[b]);
        body.is_some_and(|body| body.alone || body.inner.contains(&slot))
    }

    /// The springs to targets at nodes of rigid bodies. `place` gives slots, `rest` is in m.
    pub fn tethers(
        &self,
        attachments: &[Attachment],
        (place, rest): (&[u32], &[DVec3]),
        units: &Units,
    ) -> Vec<Tether> {
        let springs = attachments.iter().filter_map(|a| {
            let Attachment::Pull {
                node,
                target,
                stiffness,
                limit,
            } = *a
            else {
                return None;
            };
            let slot = place[node as usize] as usize;
            if !self.tethers_at(slot) {
                return None;
            }
            let body = &self.bodies[self.of(slot)?];
            let arm = body.gather * self.arms[slot - self.first];
            let first = body.carriers().start as u32;
            Some(Tether {
                nodes: [first, first + 1, first + 2, first + 3],
                weights: CORNERS.map(|t| (1.0 + t.dot(arm)) / CARRIERS as f64),
                to: (target - rest[node as usize]) / units.length,
                stiffness: stiffness / units.stiffness(),
                limit: limit / units.force(),
            })
        });
        springs.collect()
    }

    /// Hands forces on the nodes inside, in the order of the network, to the carriers, which come
    /// last: forces that do not turn with the body. `order` is the network's number of every slot.
    pub fn hand_over(&self, forces: &mut [DVec3], order: &[u32]) {
        for body in &self.bodies {
            let (mut sum, mut moment) = (DVec3::ZERO, DMat3::ZERO);
            for i in body.inner.clone() {
                let f = std::mem::take(&mut forces[order[i] as usize]);
                sum += f;
                moment += outer(f, self.arms[i - self.first]);
            }
            for (i, share) in body.carriers().zip(shares(body, sum, moment)) {
                forces[order[i] as usize] = share;
            }
        }
    }

    /// Hands the forces on the nodes of a body's surface to its carriers: `f` is that of a chunk that begins with node `start`.
    pub fn load<T: Real>(&self, b: usize, start: usize, f: &mut [V4<T>]) {
        let body = &self.bodies[b];
        let (mut sum, mut moment) = (DVec3::ZERO, DMat3::ZERO);
        for i in body.nodes.start..body.nodes.end - CARRIERS {
            let force = &mut f[i - start];
            if force[..3].iter().any(|x| *x != T::ZERO) {
                let one = wide(*force);
                sum += one;
                moment += outer(one, self.arms[i - self.first]);
                *force = zero();
            }
        }
        let shares = shares(body, sum, moment);
        for (i, share) in body.carriers().zip(shares) {
            let own = wide(f[i - start]);
            f[i - start] = narrow(own + share);
        }
    }
}

/// What a force, and the sum of f rᵀ with it, are on the carriers: the same of any affine motion.
fn shares(body: &Rigid, sum: DVec3, moment: DMat3) -> [DVec3; CARRIERS] {
    let turned = moment * body.gather.transpose();
    CORNERS.map(|t| (sum + turned * t) / CARRIERS as f64)
}
