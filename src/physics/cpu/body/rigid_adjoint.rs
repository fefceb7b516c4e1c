//! Rigid bodies in the reverse of a step.

use super::CpuBody;
use super::step_adjoint::{Slots, Step};
use crate::physics::cpu::implicit::schemes::ImplicitScheme;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::rigid::midpoint_adjoint::{
    EndDerivative, PoseDerivative, StartDerivative,
};
use crate::physics::cpu::rigid::pose::{DegreesOfFreedom, PROXY_NODES, Pose};
use crate::physics::cpu::runtime::motion_adjoint::{MotionState, StateAdjoint};
use crate::physics::cpu::vectors::{V4, scale, sub, to_dvec, to_v4, zero};
use glam::DVec3;

impl Step {
    /// Places the bodies of a step of the midpoint rule from a state to another, which start as
    /// `rigid` is now.
    pub(super) fn place_midpoint(&mut self, rigid: &RigidBodies, [from, to]: [&MotionState; 2]) {
        let gamma = self.coefficients.gamma;
        for (b, body) in rigid.bodies.iter().enumerate() {
            self.poses[b] = rigid.middle(b, &from.poses[b], &to.poses[b]);
            let start = rigid.midpoint_start(b, &from.v);
            self.starts.push(start);
            let slots = || body.nodes.clone().chain(body.inner.clone());
            for i in slots() {
                self.u[i] = to_v4(rigid.displacement(i, &self.poses[b]));
                self.w[i] = scale(1.0 / gamma, sub(self.u[i], from.u[i]));
            }
            if body.freedom == DegreesOfFreedom::Fixed {
                slots().for_each(|i| self.inertia[i] = zero());
                continue;
            }
            let targets = rigid.inertial_target(b, gamma, &start);
            for (i, target) in body.proxy_nodes().zip(targets) {
                let off = to_dvec(sub(self.u[i], from.u[i])) - target;
                let drag = self.mass_damping * to_dvec(self.w[i]);
                self.inertia[i] = to_v4(off / (gamma * gamma) + drag);
            }
            rigid.write_velocities(b, true, &mut self.inertia);
        }
    }
}

/// Derivatives by the ends of the rigid bodies of a step, passed on to its start and its middle.
#[derive(Default)]
pub(super) struct RigidEnds {
    /// Derivatives by the motions at the start, and by the poses at the middle. None without the
    /// midpoint rule, and for fixed bodies.
    all: Vec<Option<(StartDerivative, PoseDerivative)>>,
}

impl RigidEnds {
    /// Adds the derivatives by the poses at the middle to those by degrees of freedom, the first
    /// of bodies at `soft`.
    pub fn add_to_freedoms(&self, rigid: &RigidBodies, soft: usize, right: &mut [f64]) {
        for (b, ends) in self.all.iter().enumerate() {
            let Some((_, [shift, turn])) = ends else {
                continue;
            };
            let body = &rigid.bodies[b];
            let (_, within) = body.pivot(&rigid.now[b]);
            let shift = match body.freedom {
                DegreesOfFreedom::Free => *shift,
                _ => DVec3::ZERO,
            };
            let own = shift.to_array().into_iter();
            let own = own.chain((within * *turn).to_array());
            let all = right[soft + 6 * b..].iter_mut().zip(own);
            all.for_each(|(right, own)| *right += own);
        }
    }
}

impl CpuBody<f64> {
    fn has_midpoint_bodies(&self) -> bool {
        self.scheme() == ImplicitScheme::Midpoint
            && self.newton.as_ref().is_some_and(|n| !n.rigid.is_empty())
    }

    /// Moves the derivatives by the velocities of interior nodes to the proxy nodes, whose
    /// velocities determine them at the end of a step of Euler or BDF2.
    pub(super) fn gather_interior_velocities(&self, by_v: &mut [V4<f64>]) {
        let Some(newton) = self.newton.as_ref().filter(|_| !self.has_midpoint_bodies()) else {
            return;
        };
        for (b, body) in newton.rigid.bodies.iter().enumerate() {
            if body.freedom != DegreesOfFreedom::Fixed {
                newton.rigid.transfer_velocity_derivatives(b, by_v);
            }
        }
    }

    /// Corrects `right` and `adjoint` for nodes that their bodies place at the end of a step, whose
    /// state `to` has the derivatives `by_u` and `by_v`.
    pub(super) fn reverse_rigid_ends(
        &self,
        (step, to): (&Step, &MotionState),
        [by_u, by_v]: [&Slots; 2],
        by_torques: &[DVec3],
        (right, adjoint): (&mut Slots, &mut StateAdjoint),
    ) -> RigidEnds {
        let Some(newton) = &self.newton else {
            return RigidEnds::default();
        };
        let (rigid, is_midpoint) = (&newton.rigid, self.has_midpoint_bodies());
        let gamma = step.coefficients.gamma;
        let ends = rigid.bodies.iter().enumerate().map(|(b, body)| {
            if body.freedom == DegreesOfFreedom::Fixed {
                return None;
            }
            for i in body.inner.clone() {
                right[i] = by_u[i];
                (adjoint.u[i], adjoint.v[i]) = (zero(), zero());
            }
            if !is_midpoint {
                return None;
            }
            for i in body.nodes.clone().chain(body.inner.clone()) {
                right[i] = zero();
                (adjoint.u[i], adjoint.v[i]) = (zero(), zero());
                adjoint.moved[i] = zero();
            }
            let by_end = EndDerivative {
                pose: rigid.resultant(b, &to.poses[b], by_u),
                velocities: rigid.velocity_moments(b, by_v),
                torque: by_torques.get(b).copied().unwrap_or_default(),
            };
            let at = (&step.starts[b], &step.poses[b]);
            Some(rigid.end_derivative((b, gamma), at, &by_end))
        });
        RigidEnds {
            all: ends.collect(),
        }
    }

    /// Adds the derivatives by the motions of the bodies at the start of a step of the midpoint
    /// rule, at the poses `from` and the velocities `v`, through its end and through z.
    pub(super) fn pull_back_rigid(
        &mut self,
        (from, v): (&[Pose], &[V4<f64>]),
        (step, z): (&Step, &[V4<f64>]),
        ends: &RigidEnds,
        adjoint: &mut StateAdjoint,
    ) {
        if !self.has_midpoint_bodies() {
            return;
        }
        let Some(newton) = &mut self.newton else {
            return;
        };
        newton.rigid.now.copy_from_slice(from);
        let (rigid, gamma) = (&newton.rigid, step.coefficients.gamma);
        adjoint.torques = vec![DVec3::ZERO; rigid.bodies.len()];
        for (b, ends) in ends.all.iter().enumerate() {
            let Some((by_start, _)) = ends else {
                continue;
            };
            let body = &rigid.bodies[b];
            let m = body.mass / PROXY_NODES as f64 / (gamma * gamma);
            let first = body.proxy_nodes().start;
            let weights = std::array::from_fn(|k| m * to_dvec(z[first + k]));
            let by_target = rigid.target_derivative((b, gamma), &step.starts[b], weights);
            for by in [by_start, &by_target] {
                rigid.add_start_derivative((b, v), by, [&mut adjoint.u, &mut adjoint.v]);
                adjoint.torques[b] += by.torque;
            }
        }
    }
}
