//! Forces on rigid bodies from outside: handed to their carriers.

use super::loads::Attachment;
use super::real::Real;
use super::rigid::RigidBodies;
use super::rigid_pose::{CARRIERS, CORNERS, Rigid, narrow, outer, wide};
use super::vectors::{V4, zero};
use crate::physics::Units;
use glam::{DMat3, DVec3};

/// A spring to a target at a node inside a body: which body and node, the target, stiffness and
/// limit, local units.
#[derive(Clone, Copy, Debug)]
pub(super) struct InnerDraw {
    body: usize,
    node: usize,
    target: DVec3,
    stiffness: f64,
    limit: f64,
}

impl RigidBodies {
    /// Sets the springs to targets at nodes inside. `place` gives slots.
    pub fn set_draws(&mut self, attachments: &[Attachment], place: &[u32], units: &Units) {
        self.draws.clear();
        self.drawn.fill([DVec3::ZERO; CARRIERS]);
        for a in attachments {
            let Attachment::Pull {
                node,
                target,
                stiffness,
                limit,
            } = *a
            else {
                continue;
            };
            let slot = place[node as usize] as usize;
            if let Some(body) = self.of(slot)
                && self.bodies[body].inner.contains(&slot)
            {
                self.draws.push(InnerDraw {
                    body,
                    node: slot,
                    target: target / units.length,
                    stiffness: stiffness / units.stiffness(),
                    limit: limit / units.force(),
                });
            }
        }
    }

    /// Reckons what these pull with now.
    pub fn draw(&mut self) {
        if self.draws.is_empty() {
            return;
        }
        self.drawn.fill([DVec3::ZERO; CARRIERS]);
        for d in &self.draws {
            let (body, pose) = (&self.bodies[d.body], &self.now[d.body]);
            let r = self.arms[d.node - self.first];
            let x = body.centre + pose.shift + pose.turn * r;
            let pull = ((d.target - x) * d.stiffness).clamp_length_max(d.limit);
            let shares = shares(body, pull, outer(pull, r));
            for (f, share) in self.drawn[d.body].iter_mut().zip(shares) {
                *f += share;
            }
        }
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

    /// Hands the forces on the nodes of a body's surface, and those of springs inside, to its
    /// carriers: `f` is that of a chunk that begins with node `start`.
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
        for ((i, share), drawn) in body.carriers().zip(shares).zip(self.drawn[b]) {
            let own = wide(f[i - start]);
            f[i - start] = narrow(own + share + drawn);
        }
    }
}

/// What a force, and the sum of f rᵀ with it, are on the carriers: the same of any affine motion.
fn shares(body: &Rigid, sum: DVec3, moment: DMat3) -> [DVec3; CARRIERS] {
    let turned = moment * body.gather.transpose();
    CORNERS.map(|t| (sum + turned * t) / CARRIERS as f64)
}
