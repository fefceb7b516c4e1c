//! Rigid bodies in the midpoint rule.
//!
//! From the pose R₀ with the angular momentum ℓ₀, a step of 2γ rotates a body by φ to the midpoint,
//! where forces are evaluated, and by φ again to the end: R = exp(φ) R₀, R₁ = exp(φ) R, with I(R)
//! φ/γ = ℓ = ½(ℓ₀ + ℓ₁) and ℓ − ℓ₀ = γ τ(R). The rule is time-symmetric and therefore of second
//! order, and a free rotation conserves the angular momentum up to rounding.
//!
//! No energy of R has the gradient (I(R) φ/γ − ℓ₀)/γ. But inertia that pulls the proxy nodes to
//! target positions has the exact gradient at a guess R₊, and a second-order accurate one at R, if
//! the guess uses the torque of the previous step: the targets are then the positions in R₊,
//! rotated further by γ (I(R₊)⁻¹ ℓ₀ − φ₊/γ).

use super::bodies::RigidBodies;
use super::pose::{DegreesOfFreedom, PROXY_NODES, Pose, inertia_of, rotation_response};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::to_v4;
use glam::{DMat3, DQuat, DVec3};

/// Fixed-point iterations of a guess; each gains one order in the rotation.
const FIXED_POINT_ITERATIONS: usize = 12;

impl RigidBodies {
    /// Returns the inertia of a body about its pivot, rotated by `turn`.
    fn inertia(&self, b: usize, turn: DQuat) -> DMat3 {
        let body = &self.bodies[b];
        let (pivot, _) = body.pivot(&self.now[b]);
        let mut sum = DMat3::ZERO;
        for i in body.proxy_nodes() {
            sum += inertia_of(turn * (self.lever_arms[i - self.first] - pivot));
        }
        sum * (body.mass / PROXY_NODES as f64)
    }

    /// Returns the displacements of a body's proxy nodes to which inertia alone pulls them in a
    /// step of 2 `gamma`: from its pose, its velocities `v` and the torque of the previous step.
    pub fn inertial_target<T: Real>(
        &self,
        b: usize,
        gamma: f64,
        v: &[V4<T>],
    ) -> [DVec3; PROXY_NODES] {
        let (body, now) = (&self.bodies[b], &self.now[b]);
        let (pivot, within) = body.pivot(now);
        let (sum, spin) = self.momentum(b, v);
        let mean = match body.freedom {
            DegreesOfFreedom::Free => sum * (gamma / body.mass),
            _ => DVec3::ZERO,
        };
        let expected = spin + self.torques[b] * gamma;
        let mut by = DVec3::ZERO;
        for _ in 0..FIXED_POINT_ITERATIONS {
            let inertia = self.inertia(b, DQuat::from_scaled_axis(by) * now.rotation);
            by = rotation_response(inertia, expected, within) * gamma;
        }
        let turn = DQuat::from_scaled_axis(by) * now.rotation;
        let on = rotation_response(self.inertia(b, turn), spin, within) * gamma - by;
        let mut places = [DVec3::ZERO; PROXY_NODES];
        for (x, i) in places.iter_mut().zip(body.proxy_nodes()) {
            let r = self.lever_arms[i - self.first] - pivot;
            let there = turn * r;
            *x = mean + there + on.cross(there) - now.rotation * r;
        }
        places
    }

    /// Ends a step of 2 `gamma` with the midpoint at the best trial: stores the poses at the end as
    /// the best ones, and the velocities of the bodies' nodes there.
    pub fn extrapolate_end<T: Real>(&mut self, gamma: f64, before: &[V4<T>], after: &mut [V4<T>]) {
        for b in 0..self.bodies.len() {
            let (now, middle) = (self.now[b], self.best[b]);
            let (pivot, within) = self.bodies[b].pivot(&now);
            let (sum, spin) = self.momentum(b, before);
            let step = (middle.rotation * now.rotation.inverse()).normalize();
            // The shorter of the two rotations.
            let step = if step.w < 0.0 { -step } else { step };
            let by = within * step.to_scaled_axis();
            let turn = (DQuat::from_scaled_axis(by) * middle.rotation).normalize();
            let at = |pose: &Pose| pose.translation + pose.rotation * pivot;
            let free = self.bodies[b].freedom == DegreesOfFreedom::Free;
            let moved = if free {
                at(&middle) - at(&now)
            } else {
                DVec3::ZERO
            };
            let half = self.inertia(b, middle.rotation) * by / gamma;
            self.torques[b] = (half - spin) / gamma;
            self.best[b] = match self.bodies[b].freedom {
                DegreesOfFreedom::Fixed => now,
                _ => Pose {
                    translation: at(&now) + 2.0 * moved - turn * pivot,
                    rotation: turn,
                },
            };
            let linear = moved * (2.0 / gamma) - sum / self.bodies[b].mass;
            let spin = rotation_response(self.inertia(b, turn), 2.0 * half - spin, within);
            let body = &self.bodies[b];
            for i in body.nodes.clone().chain(body.inner.clone()) {
                let a = turn * (self.lever_arms[i - self.first] - pivot);
                let own = if free { linear } else { DVec3::ZERO };
                after[i] = match body.freedom {
                    DegreesOfFreedom::Fixed => to_v4(DVec3::ZERO),
                    _ => to_v4(own + spin.cross(a)),
                };
            }
        }
    }

    /// Forgets the torques of the last step.
    pub fn clear_torques(&mut self) {
        self.torques.fill(DVec3::ZERO);
    }
}
