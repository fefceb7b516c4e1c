//! The adjoint of rigid bodies in the midpoint rule: derivatives of the inertial target and of the
//! end of a step by the motion at its start and by the pose at its middle.
//!
//! Both are functions of some twenty numbers, whose derivatives are differences of fourth order,
//! exact to about 1e-10.

use super::bodies::RigidBodies;
use super::midpoint::{MidpointEnd, MidpointStart};
use super::pose::{PROXY_NODES, Pose};
use crate::physics::cpu::differences::gradient;
use crate::physics::cpu::vectors::outer;
use crate::physics::cpu::vectors::{V4, add, to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// Step of differences, over the scale of each number.
const DIFFERENCE_STEP: f64 = 1e-3;

/// Derivatives of a number by a pose: by a translation, and by a rotation vector about the pivot.
pub(in crate::physics::cpu) type PoseDerivative = [DVec3; 2];

/// Derivatives of a number by a [`MidpointStart`].
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics::cpu) struct StartDerivative {
    pub pose: PoseDerivative,
    pub sum: DVec3,
    pub spin: DVec3,
    pub torque: DVec3,
}

/// Derivatives of a number by the end of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics::cpu) struct EndDerivative {
    pub pose: PoseDerivative,
    /// Σ q, and Σ r qᵀ over the body's nodes, for the derivatives q by their velocities and their
    /// rest positions r from the pivot.
    pub velocities: (DVec3, DMat3),
    pub torque: DVec3,
}

impl RigidBodies {
    /// Returns the derivatives by the start of a step of 2 `gamma` of Σ `weights`·displacement over
    /// the inertial targets of the proxy nodes.
    pub fn target_derivative(
        &self,
        (b, gamma): (usize, f64),
        start: &MidpointStart,
        weights: [DVec3; PROXY_NODES],
    ) -> StartDerivative {
        self.start_derivative((b, gamma), start, |start| {
            let places = self.inertial_target(b, gamma, start);
            places.iter().zip(weights).map(|(x, w)| x.dot(w)).sum()
        })
    }

    /// Returns the derivatives of a number by the start of a step of 2 `gamma` and by the pose
    /// `middle`, from those by its end.
    pub fn end_derivative(
        &self,
        (b, gamma): (usize, f64),
        (start, middle): (&MidpointStart, &Pose),
        by_end: &EndDerivative,
    ) -> (StartDerivative, PoseDerivative) {
        let body = &self.bodies[b];
        let nominal = self.midpoint_end(b, gamma, start, middle);
        let value = |start: &MidpointStart, middle: &Pose| {
            let end = self.midpoint_end(b, gamma, start, middle);
            self.end_change(b, &nominal, &end, by_end)
        };
        let by_start = self.start_derivative((b, gamma), start, |start| value(start, middle));
        let [length, angle] = [DIFFERENCE_STEP * body.radius(), DIFFERENCE_STEP];
        let shifted = |by| value(start, &body.displaced(middle, by, DVec3::ZERO));
        let turned = |by| value(start, &body.displaced(middle, DVec3::ZERO, by));
        (
            by_start,
            [gradient(length, shifted), gradient(angle, turned)],
        )
    }

    /// Returns to first order the change of a number from the end `nominal` to `end`.
    fn end_change(
        &self,
        b: usize,
        nominal: &MidpointEnd,
        end: &MidpointEnd,
        by: &EndDerivative,
    ) -> f64 {
        let (pivot, _) = self.bodies[b].pivot(&end.pose);
        let at = |pose: &Pose| pose.translation + pose.rotation * pivot;
        let turn = (end.pose.rotation * nominal.pose.rotation.inverse()).normalize();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let moved = (at(&end.pose) - at(&nominal.pose)).dot(by.pose[0]);
        let turned = turn.to_scaled_axis().dot(by.pose[1]);
        let (sum, moments) = by.velocities;
        // Σ (R r) × q.
        let m = DMat3::from_quat(end.pose.rotation) * moments;
        let spin = DVec3::new(
            m.z_axis.y - m.y_axis.z,
            m.x_axis.z - m.z_axis.x,
            m.y_axis.x - m.x_axis.y,
        );
        moved + turned + end.linear.dot(sum) + end.angular.dot(spin) + end.torque.dot(by.torque)
    }

    fn start_derivative(
        &self,
        (b, gamma): (usize, f64),
        start: &MidpointStart,
        value: impl Fn(&MidpointStart) -> f64,
    ) -> StartDerivative {
        let body = &self.bodies[b];
        let (length, momentum) = (body.radius(), body.mass * body.radius() / gamma);
        let with = |change: &dyn Fn(&mut MidpointStart)| {
            let mut changed = *start;
            change(&mut changed);
            value(&changed)
        };
        let step = DIFFERENCE_STEP;
        let pose = [
            gradient(step * length, |by| {
                with(&|s| s.pose = body.displaced(&start.pose, by, DVec3::ZERO))
            }),
            gradient(step, |by| {
                with(&|s| s.pose = body.displaced(&start.pose, DVec3::ZERO, by))
            }),
        ];
        StartDerivative {
            pose,
            sum: gradient(step * momentum, |by| with(&|s| s.sum += by)),
            spin: gradient(step * momentum * length, |by| with(&|s| s.spin += by)),
            torque: gradient(step * momentum * length / gamma, |by| {
                with(&|s| s.torque += by)
            }),
        }
    }

    /// Adds derivatives by the motion of a body in its pose now to those by the displacements and
    /// the velocities of nodes.
    pub fn add_start_derivative(
        &self,
        (b, v): (usize, &[V4<f64>]),
        by: &StartDerivative,
        [by_u, by_v]: [&mut [V4<f64>]; 2],
    ) {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, _) = body.pivot(pose);
        let m = body.mass / PROXY_NODES as f64;
        let [force, mut moment] = by.pose;
        for i in body.proxy_nodes() {
            let arm = pose.rotation * (self.lever_arms[i - self.first] - pivot);
            // The angular momentum is Σ m a × v.
            moment += m * arm.cross(to_dvec(v[i]).cross(by.spin));
            by_v[i] = add(by_v[i], to_v4(m * (by.sum + by.spin.cross(arm))));
        }
        for (i, f) in self.proxy_forces(b, (force, moment)) {
            by_u[i] = add(by_u[i], to_v4(f));
        }
    }

    /// Returns the pose at the middle of a step of a body from a pose to another.
    pub fn middle(&self, b: usize, from: &Pose, to: &Pose) -> Pose {
        let (pivot, _) = self.bodies[b].pivot(from);
        let step = (to.rotation * from.rotation.inverse()).normalize();
        let step = if step.w < 0.0 { -step } else { step };
        let turn = DQuat::from_scaled_axis(0.5 * step.to_scaled_axis()) * from.rotation;
        let at = |pose: &Pose| pose.translation + pose.rotation * pivot;
        Pose {
            translation: 0.5 * (at(from) + at(to)) - turn * pivot,
            rotation: turn.normalize(),
        }
    }

    /// Returns the sum of forces on the nodes of a body in a pose, and their moment about its
    /// pivot.
    pub fn resultant(&self, b: usize, pose: &Pose, f: &[V4<f64>]) -> PoseDerivative {
        let body = &self.bodies[b];
        let (pivot, _) = body.pivot(pose);
        let nodes = body.nodes.clone().chain(body.inner.clone());
        nodes.fold([DVec3::ZERO; 2], |[sum, moment], i| {
            let arm = pose.rotation * (self.lever_arms[i - self.first] - pivot);
            let f = to_dvec(f[i]);
            [sum + f, moment + arm.cross(f)]
        })
    }

    /// Returns the sums of [`EndDerivative::velocities`] over the nodes of a body.
    pub fn velocity_moments(&self, b: usize, by_v: &[V4<f64>]) -> (DVec3, DMat3) {
        let body = &self.bodies[b];
        let (pivot, _) = body.pivot(&self.now[b]);
        let nodes = body.nodes.clone().chain(body.inner.clone());
        nodes.fold((DVec3::ZERO, DMat3::ZERO), |(sum, moments), i| {
            let q = to_dvec(by_v[i]);
            let arm = self.lever_arms[i - self.first] - pivot;
            (sum + q, moments + outer(arm, q))
        })
    }
}
