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

/// Motion of a body at the start of a step.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct MidpointStart {
    pub pose: Pose,
    /// Momentum, and angular momentum about the pivot, ℓ₀.
    pub sum: DVec3,
    pub spin: DVec3,
    /// Torque in the last step.
    pub torque: DVec3,
}

/// Motion of a body at the end of a step.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct MidpointEnd {
    pub pose: Pose,
    /// Velocity of the pivot, and angular velocity.
    pub linear: DVec3,
    pub angular: DVec3,
    /// Torque in the step.
    pub torque: DVec3,
}

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

    /// Returns the motion of a body with the velocities `v`.
    pub fn midpoint_start<T: Real>(&self, b: usize, v: &[V4<T>]) -> MidpointStart {
        let (sum, spin) = self.momentum(b, v);
        MidpointStart {
            pose: self.now[b],
            sum,
            spin,
            torque: self.torques[b],
        }
    }

    /// Returns the displacements of a body's proxy nodes to which inertia alone pulls them in a
    /// step of 2 `gamma`: from its pose, its momenta and the torque of the previous step.
    pub fn inertial_target(
        &self,
        b: usize,
        gamma: f64,
        start: &MidpointStart,
    ) -> [DVec3; PROXY_NODES] {
        let (body, now) = (&self.bodies[b], &start.pose);
        let (pivot, within) = body.pivot(now);
        let mean = match body.freedom {
            DegreesOfFreedom::Free => start.sum * (gamma / body.mass),
            _ => DVec3::ZERO,
        };
        let expected = start.spin + start.torque * gamma;
        let mut by = DVec3::ZERO;
        for _ in 0..FIXED_POINT_ITERATIONS {
            let inertia = self.inertia(b, DQuat::from_scaled_axis(by) * now.rotation);
            by = rotation_response(inertia, expected, within) * gamma;
        }
        let turn = DQuat::from_scaled_axis(by) * now.rotation;
        let on = rotation_response(self.inertia(b, turn), start.spin, within) * gamma - by;
        let mut places = [DVec3::ZERO; PROXY_NODES];
        for (x, i) in places.iter_mut().zip(body.proxy_nodes()) {
            let r = self.lever_arms[i - self.first] - pivot;
            let there = turn * r;
            *x = mean + there + on.cross(there) - now.rotation * r;
        }
        places
    }

    /// Returns the end of a step of 2 `gamma` of a body that is not fixed, with the midpoint at
    /// the pose `middle`.
    pub fn midpoint_end(
        &self,
        b: usize,
        gamma: f64,
        start: &MidpointStart,
        middle: &Pose,
    ) -> MidpointEnd {
        let (body, now) = (&self.bodies[b], &start.pose);
        let (pivot, within) = body.pivot(now);
        let step = (middle.rotation * now.rotation.inverse()).normalize();
        // The shorter of the two rotations.
        let step = if step.w < 0.0 { -step } else { step };
        let by = within * step.to_scaled_axis();
        let turn = (DQuat::from_scaled_axis(by) * middle.rotation).normalize();
        let at = |pose: &Pose| pose.translation + pose.rotation * pivot;
        let is_free = body.freedom == DegreesOfFreedom::Free;
        let moved = match is_free {
            true => at(middle) - at(now),
            false => DVec3::ZERO,
        };
        let half = self.inertia(b, middle.rotation) * by / gamma;
        let linear = match is_free {
            true => moved * (2.0 / gamma) - start.sum / body.mass,
            false => DVec3::ZERO,
        };
        MidpointEnd {
            pose: Pose {
                translation: at(now) + 2.0 * moved - turn * pivot,
                rotation: turn,
            },
            linear,
            angular: rotation_response(self.inertia(b, turn), 2.0 * half - start.spin, within),
            torque: (half - start.spin) / gamma,
        }
    }

    /// Ends a step of 2 `gamma` with the midpoint at the best trial: stores the poses at the end as
    /// the best ones, and the velocities of the bodies' nodes there.
    pub fn extrapolate_end<T: Real>(&mut self, gamma: f64, before: &[V4<T>], after: &mut [V4<T>]) {
        for b in 0..self.bodies.len() {
            let body = &self.bodies[b];
            let nodes = body.nodes.clone().chain(body.inner.clone());
            if body.freedom == DegreesOfFreedom::Fixed {
                nodes.for_each(|i| after[i] = to_v4(DVec3::ZERO));
                self.best[b] = self.now[b];
                self.torques[b] = DVec3::ZERO;
                continue;
            }
            let start = self.midpoint_start(b, before);
            let end = self.midpoint_end(b, gamma, &start, &self.best[b]);
            let (pivot, _) = body.pivot(&start.pose);
            for i in nodes {
                let arm = end.pose.rotation * (self.lever_arms[i - self.first] - pivot);
                after[i] = to_v4(end.linear + end.angular.cross(arm));
            }
            (self.best[b], self.torques[b]) = (end.pose, end.torque);
        }
    }

    /// Forgets the torques of the last step.
    pub fn clear_torques(&mut self) {
        self.torques.fill(DVec3::ZERO);
    }
}
