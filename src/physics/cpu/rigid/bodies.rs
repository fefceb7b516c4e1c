//! Rigid bodies: nodes that move together, with six unknowns.
//!
//! The engine's nodes of a body are its surface nodes, without mass, and four **proxy nodes** with
//! all of its mass: at R A t_k from its centre, with t_k the corners of a regular tetrahedron and A
//! Aᵀ the body's mean of r rᵀ, they have its exact mass, centre and inertia under any affine
//! motion. A body's inertia, gravity and history are therefore those of four ordinary nodes, and a
//! step is the same minimisation as without rigid bodies, over x = c + R r. Interior nodes take no
//! part; their positions are set afterwards.
//!
//! Poses are stored in f64, and every node's displacement is rounded from them, so errors do not
//! accumulate.

use super::closest_rotation::closest_rotation;
use super::pose::{
    DegreesOfFreedom, PROXY_NODES, PROXY_POSITIONS, Pose, RigidGroup, inertia_of, rotation_response,
};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::outer;
use crate::physics::cpu::vectors::{to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// The rigid bodies of a body, whose nodes are the last of its plan and those beyond it.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct RigidBodies {
    /// First slot of any body.
    pub first: usize,
    /// The bodies in order, each a group of the plan.
    pub bodies: Vec<RigidGroup>,
    /// Position of each node relative to its body's centre at rest, beginning with the first slot.
    pub lever_arms: Vec<DVec3>,
    /// Body of each node.
    owner: Vec<u32>,
    /// Mass of each of the mesh's nodes, carried by its body.
    pub weights: Vec<f64>,
    /// Poses at the start of the step, of the best trial, and of the last trial.
    pub now: Vec<Pose>,
    pub best: Vec<Pose>,
    pub trial: Vec<Pose>,
    /// Target poses of constrained bodies in the step, and the fraction of that motion applied in
    /// trials.
    pub targets: Vec<Option<Pose>>,
    pub prescribed_fraction: f64,
    /// Translation and rotation vector from now to the last trial.
    changes: Vec<(DVec3, DMat3)>,
    /// Search direction: translation and rotation vector.
    pub directions: Vec<(DVec3, DVec3)>,
    /// For the midpoint rule: the torque on each body in the last step.
    pub torques: Vec<DVec3>,
    /// Whether steps use the midpoint rule.
    pub midpoint: bool,
}

impl Default for RigidBodies {
    fn default() -> Self {
        RigidBodies::new(usize::MAX, Vec::new(), Vec::new(), Vec::new())
    }
}

impl RigidBodies {
    /// Creates the bodies at rest, free.
    pub fn new(
        first: usize,
        bodies: Vec<RigidGroup>,
        lever_arms: Vec<DVec3>,
        weights: Vec<f64>,
    ) -> RigidBodies {
        let mut owner = vec![0; lever_arms.len()];
        for (b, body) in bodies.iter().enumerate() {
            for slots in [&body.nodes, &body.inner] {
                owner[slots.start - first..slots.end - first].fill(b as u32);
            }
        }
        let poses = vec![Pose::REST; bodies.len()];
        RigidBodies {
            first,
            lever_arms,
            owner,
            weights,
            now: poses.clone(),
            best: poses.clone(),
            trial: poses,
            targets: vec![None; bodies.len()],
            prescribed_fraction: 1.0,
            changes: vec![(DVec3::ZERO, DMat3::ZERO); bodies.len()],
            directions: vec![(DVec3::ZERO, DVec3::ZERO); bodies.len()],
            torques: vec![DVec3::ZERO; bodies.len()],
            midpoint: false,
            bodies,
        }
    }

    /// Whether there are no bodies.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Returns the body of slot `i`.
    pub fn body_of(&self, i: usize) -> Option<usize> {
        let n = i.checked_sub(self.first)?;
        self.owner.get(n).map(|b| *b as usize)
    }

    /// Returns the displacement of a slot from rest in a pose of its body.
    pub fn displacement(&self, i: usize, pose: &Pose) -> DVec3 {
        let r = self.lever_arms[i - self.first];
        pose.translation + (pose.rotation * r - r)
    }

    /// Sets the trial poses to those closest to the proxy nodes' displacements `at` from now.
    pub fn set_trial_from<T: Real>(&mut self, at: impl Fn(usize) -> V4<T>) {
        for (b, body) in self.bodies.iter().enumerate() {
            let from = self.now[b];
            let mut targets = [DVec3::ZERO; PROXY_NODES];
            for (x, i) in targets.iter_mut().zip(body.proxy_nodes()) {
                let r = from.rotation * self.lever_arms[i - self.first];
                *x = body.centre + from.translation + r + to_dvec(at(i));
            }
            self.trial[b] = body.closest_pose(&from, targets);
        }
        self.note_changes();
    }

    /// Sets the current poses, and the torques of the last step.
    pub fn set_motion(&mut self, poses: &[Pose], torques: &[DVec3]) {
        self.now.copy_from_slice(poses);
        self.torques.copy_from_slice(torques);
    }

    /// Sets the trial to the current poses.
    pub fn reset_trial(&mut self) {
        self.trial.copy_from_slice(&self.now);
        self.note_changes();
    }

    /// Extracts the bodies' search direction from a vector of all nodes that moves them rigidly
    /// from the best trial.
    pub fn read_directions<T: Real>(&mut self, vector: &[V4<T>]) {
        for (b, body) in self.bodies.iter().enumerate() {
            let pose = &self.best[b];
            let (pivot, within) = body.pivot(pose);
            let (mut sum, mut moment, mut inertia) = (DVec3::ZERO, DVec3::ZERO, DMat3::ZERO);
            for i in body.proxy_nodes() {
                let a = pose.rotation * (self.lever_arms[i - self.first] - pivot);
                let s = to_dvec(vector[i]);
                sum += s;
                moment += a.cross(s);
                inertia += inertia_of(a);
            }
            let free = body.freedom == DegreesOfFreedom::Free;
            let shift = if free {
                sum / PROXY_NODES as f64
            } else {
                DVec3::ZERO
            };
            self.directions[b] = (shift, within * rotation_response(inertia, moment, within));
        }
    }

    /// Sets the trial to a step along the direction from the best trial.
    pub fn move_trial(&mut self, length: f64) {
        for (b, body) in self.bodies.iter().enumerate() {
            let (shift, by) = self.directions[b];
            self.trial[b] = match body.freedom {
                DegreesOfFreedom::Fixed => self.now[b],
                _ => body.displaced(&self.best[b], shift * length, by * length),
            };
        }
        self.note_changes();
    }

    /// Translates the free bodies of the last trial.
    pub fn shift(&mut self, by: &[DVec3]) {
        for ((pose, body), by) in self.trial.iter_mut().zip(&self.bodies).zip(by) {
            if body.freedom == DegreesOfFreedom::Free {
                pose.translation += *by;
            }
        }
        self.note_changes();
    }

    /// Translates the free bodies now.
    pub fn shift_current_poses(&mut self, by: &[DVec3]) {
        for ((pose, body), by) in self.now.iter_mut().zip(&self.bodies).zip(by) {
            if body.freedom == DegreesOfFreedom::Free {
                pose.translation += *by;
            }
        }
    }

    /// Sets the trial to the best trial.
    pub fn copy_best_to_trial(&mut self) {
        self.trial.copy_from_slice(&self.best);
        self.note_changes();
    }

    fn note_changes(&mut self) {
        for (b, target) in self.targets.iter().enumerate() {
            let Some(target) = target else {
                continue;
            };
            let body = &self.bodies[b];
            let interpolated_pose = self.now[b].interpolate(target, self.prescribed_fraction);
            self.trial[b] = match body.freedom {
                // The rotation about the constrained points remains free.
                DegreesOfFreedom::Rotational(pivot, axis) => {
                    let turn = self.trial[b].rotation;
                    let along = axis.map_or(DQuat::IDENTITY, |axis| {
                        DQuat::from_rotation_arc(turn * axis, interpolated_pose.rotation * axis)
                    });
                    let turn = (along * turn).normalize();
                    Pose {
                        translation: interpolated_pose.translation
                            + interpolated_pose.rotation * pivot
                            - turn * pivot,
                        rotation: turn,
                    }
                }
                _ => interpolated_pose,
            };
        }
        for (b, change) in self.changes.iter_mut().enumerate() {
            let (now, then) = (&self.now[b], &self.trial[b]);
            let turn = DMat3::from_quat(then.rotation) - DMat3::from_quat(now.rotation);
            *change = (then.translation - now.translation, turn);
        }
    }

    /// Returns the displacement of slot `i` from now in the last trial.
    pub fn change<T: Real>(&self, i: usize) -> V4<T> {
        let n = i - self.first;
        let (shift, turn) = &self.changes[self.owner[n] as usize];
        to_v4(*shift + *turn * self.lever_arms[n])
    }

    /// Makes the last trial the best.
    pub fn accept_trial(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// Makes the best trial the current state.
    pub fn commit(&mut self) {
        self.now.copy_from_slice(&self.best);
        self.targets.fill(None);
    }

    /// Sets the nodes of all bodies according to `poses`.
    pub fn write_nodes<T: Real>(&self, poses: &[Pose], u: &mut [V4<T>]) {
        for (n, b) in self.owner.iter().enumerate() {
            let i = self.first + n;
            u[i] = to_v4(self.displacement(i, &poses[*b as usize]));
        }
    }

    /// Sets the velocities of the nodes of a body, or of its interior ones only, from its proxy
    /// nodes.
    pub fn write_velocities<T: Real>(&self, b: usize, all: bool, v: &mut [V4<T>]) {
        let body = &self.bodies[b];
        let carriers: [DVec3; PROXY_NODES] =
            std::array::from_fn(|k| to_dvec(v[body.proxy_nodes().start + k]));
        let mean = carriers.iter().sum::<DVec3>() / PROXY_NODES as f64;
        let mut change = DMat3::ZERO;
        for (v, t) in carriers.iter().zip(PROXY_POSITIONS) {
            change += outer(*v, t);
        }
        let change = change * body.inverse_inertia_map * (1.0 / PROXY_NODES as f64);
        let surface =
            body.nodes.start..body.nodes.end - if all { PROXY_NODES } else { body.nodes.len() };
        for i in surface.chain(body.inner.clone()) {
            v[i] = to_v4(mean + change * self.lever_arms[i - self.first]);
        }
    }

    /// Moves derivatives by the velocities of the interior nodes of a body to its proxy nodes: the
    /// transpose of [`RigidBodies::write_velocities`] for these.
    pub fn transfer_velocity_derivatives(&self, b: usize, by_v: &mut [V4<f64>]) {
        let body = &self.bodies[b];
        let (mut sum, mut moments) = (DVec3::ZERO, DMat3::ZERO);
        for i in body.inner.clone() {
            let q = to_dvec(std::mem::take(&mut by_v[i]));
            sum += q;
            moments += outer(
                q,
                body.inverse_inertia_map * self.lever_arms[i - self.first],
            );
        }
        for (i, t) in body.proxy_nodes().zip(PROXY_POSITIONS) {
            let share = (sum + moments * t) / PROXY_NODES as f64;
            by_v[i] = to_v4(to_dvec(by_v[i]) + share);
        }
    }

    /// Sets the velocities of a body's nodes in `pose` for the momentum `sum` and the `moment`
    /// about its pivot, within its degrees of freedom.
    pub fn set_momentum<T: Real>(&self, b: usize, (sum, moment): (DVec3, DVec3), v: &mut [V4<T>]) {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, within) = body.pivot(pose);
        let mut inertia = DMat3::ZERO;
        for i in body.proxy_nodes() {
            let a = pose.rotation * (self.lever_arms[i - self.first] - pivot);
            inertia += inertia_of(a) * (body.mass / PROXY_NODES as f64);
        }
        let (linear, spin) = match body.freedom {
            DegreesOfFreedom::Free => (sum / body.mass, inertia.inverse() * moment),
            DegreesOfFreedom::Rotational(..) => {
                (DVec3::ZERO, rotation_response(inertia, moment, within))
            }
            DegreesOfFreedom::Fixed => (DVec3::ZERO, DVec3::ZERO),
        };
        for i in body.nodes.clone().chain(body.inner.clone()) {
            let a = pose.rotation * (self.lever_arms[i - self.first] - pivot);
            v[i] = to_v4(linear + spin.cross(a));
        }
    }

    /// Returns the momentum of a body and its moment about its pivot, from its proxy nodes'
    /// velocities.
    pub fn momentum<T: Real>(&self, b: usize, v: &[V4<T>]) -> (DVec3, DVec3) {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, _) = body.pivot(pose);
        let m = body.mass / PROXY_NODES as f64;
        let (mut sum, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for i in body.proxy_nodes() {
            let a = pose.rotation * (self.lever_arms[i - self.first] - pivot);
            sum += m * to_dvec(v[i]);
            moment += m * a.cross(to_dvec(v[i]));
        }
        (sum, moment)
    }

    /// Fits the poses and momenta to positions and velocities of the mesh's nodes, weighted by
    /// mass; `of` returns those of a slot, local units. Writes all nodes of the bodies.
    pub fn fit_state<T: Real>(
        &mut self,
        of: impl Fn(usize) -> (DVec3, DVec3),
        u: &mut [V4<T>],
        v: &mut [V4<T>],
    ) {
        for b in 0..self.bodies.len() {
            let body = &self.bodies[b];
            let surface = body.nodes.start..body.nodes.end - PROXY_NODES;
            let nodes = || surface.clone().chain(body.inner.clone());
            let weight = |i: usize| self.weights[i - self.first] / body.mass;
            let at: DVec3 = nodes().map(|i| weight(i) * of(i).0).sum();
            let mut m = DMat3::ZERO;
            for i in nodes() {
                m += outer(of(i).0 - at, self.lever_arms[i - self.first]) * weight(i);
            }
            let start = crate::physics::model::elements::polar_decomposition(&m).0;
            let start = DQuat::from_mat3(&start).normalize();
            self.now[b] = Pose {
                translation: at - body.centre,
                rotation: closest_rotation(&m, start, DMat3::IDENTITY),
            };
            let (pivot, _) = body.pivot(&self.now[b]);
            let pivot = at + self.now[b].rotation * pivot;
            let (mut sum, mut moment) = (DVec3::ZERO, DVec3::ZERO);
            for i in nodes() {
                let (x, v) = of(i);
                let m = self.weights[i - self.first];
                sum += m * v;
                moment += m * (x - pivot).cross(v);
            }
            self.set_momentum(b, (sum, moment), v);
        }
        self.write_nodes(&self.now, u);
    }

    /// Sets the fixed nodes of a body (slots), which determine its degrees of freedom.
    pub fn set_constraints(&mut self, b: usize, held: impl Iterator<Item = usize>) {
        let arms = held.map(|i| self.lever_arms[i - self.first]);
        self.bodies[b].freedom = DegreesOfFreedom::of(arms, self.bodies[b].radius());
    }

    /// Returns the pose of a body that best fits pairs of slots and displacements, which include
    /// all of its fixed nodes.
    pub fn pose_from_constraints(&self, b: usize, held: &[(usize, DVec3)]) -> Pose {
        let body = &self.bodies[b];
        let from = self.now[b];
        let count = held.len() as f64;
        let arm = |i: usize| self.lever_arms[i - self.first];
        let place = |(i, u): &(usize, DVec3)| body.centre + arm(*i) + *u;
        let at = held.iter().map(place).sum::<DVec3>() / count;
        let middle = held.iter().map(|(i, _)| arm(*i)).sum::<DVec3>() / count;
        // A rotation that they do not determine is kept.
        let mut m = DMat3::from_quat(from.rotation) * (1e-9 * body.radius().powi(2));
        for one in held {
            m += outer(place(one) - at, arm(one.0) - middle);
        }
        let turn = closest_rotation(&m, from.rotation, DMat3::IDENTITY);
        Pose {
            translation: at - turn * middle - body.centre,
            rotation: turn,
        }
    }
}
