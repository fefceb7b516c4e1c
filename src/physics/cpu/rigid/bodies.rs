//! Rigid bodies: nodes that move together, by six unknowns.
//!
//! The engine's own nodes of a body are those of its surface, without mass, and four **carriers**
//! that have all of it: at R A t_k from its centre, t_k being the corners of a regular tet and
//! A Aᵀ the body's mean of r rᵀ, they have its mass, its centre and its inertia exactly, for
//! whatever moves its nodes affinely. So a body's inertia, gravity and history are those of four
//! ordinary nodes, and a step is the minimisation that it is without rigid bodies, over
//! x = c + R r. Nodes inside take no part; they are put in their places after.
//!
//! Poses are kept in f64, and every node's displacement is rounded from them: nothing adds up.

use super::closest_rotation::closest_rotation;
use super::pose::{
    DegreesOfFreedom, PROXY_NODES, PROXY_POSITIONS, Pose, RigidGroup, inertia_of, rotation_response,
};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::outer;
use crate::physics::cpu::vectors::{to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// The rigid bodies of a body, whose nodes are the last of its plan and what lies beyond it.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct RigidBodies {
    /// The first slot of any.
    pub first: usize,
    /// One after the other, a group of the plan each.
    pub bodies: Vec<RigidGroup>,
    /// Where each of their nodes is, from the first slot on: from its body's centre at rest.
    pub lever_arms: Vec<DVec3>,
    /// The body of each.
    owner: Vec<u32>,
    /// Mass of each of the mesh's nodes, which its body carries for it.
    pub weights: Vec<f64>,
    /// The poses at the start of the step, those of the best and of the last trial in it.
    pub now: Vec<Pose>,
    pub best: Vec<Pose>,
    pub trial: Vec<Pose>,
    /// Where bodies that are held go in the step, and how much of that way trials have gone.
    pub targets: Vec<Option<Pose>>,
    pub prescribed_fraction: f64,
    /// Shift and change of rotation from now to the last trial.
    changes: Vec<(DVec3, DMat3)>,
    /// Of the direction that is searched along: shift and rotation vector.
    pub directions: Vec<(DVec3, DVec3)>,
    /// Of the midpoint rule: the torque on each body in the last step.
    pub torques: Vec<DVec3>,
    /// Whether steps are those of that rule.
    pub midpoint: bool,
}

impl Default for RigidBodies {
    fn default() -> Self {
        RigidBodies::new(usize::MAX, Vec::new(), Vec::new(), Vec::new())
    }
}

impl RigidBodies {
    /// At rest, free.
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

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// The body that has slot `i`.
    pub fn body_of(&self, i: usize) -> Option<usize> {
        let n = i.checked_sub(self.first)?;
        self.owner.get(n).map(|b| *b as usize)
    }

    /// The displacement of a slot from its rest in a pose of its body.
    pub fn displacement(&self, i: usize, pose: &Pose) -> DVec3 {
        let r = self.lever_arms[i - self.first];
        pose.translation + (pose.rotation * r - r)
    }

    /// Takes the poses nearest to where `at` displaces the carriers from now for a trial.
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

    /// Stays for a trial.
    pub fn reset_trial(&mut self) {
        self.trial.copy_from_slice(&self.now);
        self.note_changes();
    }

    /// Takes note of how the bodies move in a vector of all nodes that moves them rigidly, from
    /// where they are in the best trial.
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

    /// Goes so far along the direction from the best trial, for a trial.
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

    /// Shifts the bodies of the last trial that are free to.
    pub fn shift(&mut self, by: &[DVec3]) {
        for ((pose, body), by) in self.trial.iter_mut().zip(&self.bodies).zip(by) {
            if body.freedom == DegreesOfFreedom::Free {
                pose.translation += *by;
            }
        }
        self.note_changes();
    }

    /// Shifts the bodies that are free to, now.
    pub fn shift_now(&mut self, by: &[DVec3]) {
        for ((pose, body), by) in self.now.iter_mut().zip(&self.bodies).zip(by) {
            if body.freedom == DegreesOfFreedom::Free {
                pose.translation += *by;
            }
        }
    }

    /// Takes the poses of the best trial for another.
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
            let led = self.now[b].interpolate(target, self.prescribed_fraction);
            self.trial[b] = match body.freedom {
                // It turns as it likes about where what holds it goes.
                DegreesOfFreedom::Rotational(pivot, axis) => {
                    let turn = self.trial[b].rotation;
                    let along = axis.map_or(DQuat::IDENTITY, |axis| {
                        DQuat::from_rotation_arc(turn * axis, led.rotation * axis)
                    });
                    let turn = (along * turn).normalize();
                    Pose {
                        translation: led.translation + led.rotation * pivot - turn * pivot,
                        rotation: turn,
                    }
                }
                _ => led,
            };
        }
        for (b, change) in self.changes.iter_mut().enumerate() {
            let (now, then) = (&self.now[b], &self.trial[b]);
            let turn = DMat3::from_quat(then.rotation) - DMat3::from_quat(now.rotation);
            *change = (then.translation - now.translation, turn);
        }
    }

    /// How far the last trial displaces slot `i` from now.
    pub fn change<T: Real>(&self, i: usize) -> V4<T> {
        let n = i - self.first;
        let (shift, turn) = &self.changes[self.owner[n] as usize];
        to_v4(*shift + *turn * self.lever_arms[n])
    }

    /// Makes the last trial the best.
    pub fn accept_trial(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// Makes the best trial what is now.
    pub fn commit(&mut self) {
        self.now.copy_from_slice(&self.best);
        self.targets.fill(None);
    }

    /// Puts the nodes of all bodies where the `poses` have them.
    pub fn write_nodes<T: Real>(&self, poses: &[Pose], u: &mut [V4<T>]) {
        for (n, b) in self.owner.iter().enumerate() {
            let i = self.first + n;
            u[i] = to_v4(self.displacement(i, &poses[*b as usize]));
        }
    }

    /// Gives the nodes of a body, or those inside only, the velocities that its carriers say.
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

    /// Lets a body in `pose` move on with the momentum `sum`, and `moment` about its pivot, as it
    /// can: writes the velocities of its nodes.
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

    /// The momentum of a body and its moment about its pivot, of its carriers' velocities.
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

    /// Takes the poses and the momenta that suit positions and velocities of the mesh's nodes best,
    /// each by its mass; `of` gives those of a slot, local units. Writes all nodes' of the bodies.
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

    /// Says which nodes of a body stay: how it can move follows. Slots.
    pub fn set_constraints(&mut self, b: usize, held: impl Iterator<Item = usize>) {
        let arms = held.map(|i| self.lever_arms[i - self.first]);
        self.bodies[b].freedom = DegreesOfFreedom::of(arms, self.bodies[b].radius());
    }

    /// The pose of a body in which nodes of it are as near to places as they can be: pairs of slots
    /// and displacements, all that stays of it among them.
    pub fn pose_from_constraints(&self, b: usize, held: &[(usize, DVec3)]) -> Pose {
        let body = &self.bodies[b];
        let from = self.now[b];
        let count = held.len() as f64;
        let arm = |i: usize| self.lever_arms[i - self.first];
        let place = |(i, u): &(usize, DVec3)| body.centre + arm(*i) + *u;
        let at = held.iter().map(place).sum::<DVec3>() / count;
        let middle = held.iter().map(|(i, _)| arm(*i)).sum::<DVec3>() / count;
        // Where they leave a turn open, it stays as it is.
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
