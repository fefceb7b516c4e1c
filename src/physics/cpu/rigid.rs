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
use super::loads::Attachment;
use super::real::Real;
use super::vectors::{V4, zero};
use crate::physics::Units;
use glam::{DMat3, DQuat, DVec3};
use std::ops::Range;

/// Carriers of a body.
pub(super) const CARRIERS: usize = 4;

/// Where they are: the corners of a regular tet.
const CORNERS: [DVec3; CARRIERS] = [
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, -1.0, -1.0),
    DVec3::new(-1.0, 1.0, -1.0),
    DVec3::new(-1.0, -1.0, 1.0),
];

/// Points nearer to each other than this part of a body are one, and hold it so.
const NEAR: f64 = 1e-6;

/// How a body can move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Freedom {
    /// As it likes.
    Free,
    /// About a point that stays, given from the centre at rest; if about an axis only, that.
    Turns(DVec3, Option<DVec3>),
    /// Not at all: three nodes that are not in a line are pinned or held.
    Fixed,
}

/// Where a body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// How far its centre is from where it rests.
    pub shift: DVec3,
    /// How it is turned.
    pub turn: DQuat,
}

impl Pose {
    const REST: Pose = Pose {
        shift: DVec3::ZERO,
        turn: DQuat::IDENTITY,
    };

    /// As numbers, to the bit.
    pub fn numbers(&self) -> [f64; 7] {
        let ([a, b, c], [x, y, z, w]) = (self.shift.to_array(), self.turn.to_array());
        [a, b, c, x, y, z, w]
    }

    /// What [`Pose::numbers`] gave.
    pub fn of_numbers([a, b, c, x, y, z, w]: [f64; 7]) -> Pose {
        Pose {
            shift: DVec3::new(a, b, c),
            turn: DQuat::from_array([x, y, z, w]),
        }
    }
}

/// A body. Lengths and masses in local units.
#[derive(Clone, Debug)]
pub(super) struct Rigid {
    /// Its nodes in the plan: those of the surface, then the carriers.
    pub nodes: Range<usize>,
    /// Its nodes inside, beyond the plan.
    pub inner: Range<usize>,
    /// Its centre of mass at rest.
    pub centre: DVec3,
    pub mass: f64,
    /// A, and A⁻¹.
    pub spread: DMat3,
    pub gather: DMat3,
    pub freedom: Freedom,
}

impl Rigid {
    /// What lengths are measured by: the radius of gyration.
    pub fn radius(&self) -> f64 {
        let a = self.spread;
        (a.x_axis.length_squared() + a.y_axis.length_squared() + a.z_axis.length_squared()).sqrt()
    }

    /// The carriers' slots.
    pub fn carriers(&self) -> Range<usize> {
        self.nodes.end - CARRIERS..self.nodes.end
    }

    /// The point it turns about, from its centre at rest; and which turns it makes in `pose`.
    pub fn pivot(&self, pose: &Pose) -> (DVec3, DMat3) {
        match self.freedom {
            Freedom::Free => (DVec3::ZERO, DMat3::IDENTITY),
            Freedom::Turns(at, None) => (at, DMat3::IDENTITY),
            Freedom::Turns(at, Some(axis)) => (at, outer(pose.turn * axis, pose.turn * axis)),
            Freedom::Fixed => (DVec3::ZERO, DMat3::ZERO),
        }
    }

    /// The pose after a turn by the rotation vector `by` about its pivot and a shift.
    fn moved(&self, from: &Pose, shift: DVec3, by: DVec3) -> Pose {
        let (pivot, _) = self.pivot(from);
        let turn = (DQuat::from_scaled_axis(by) * from.turn).normalize();
        Pose {
            shift: from.shift + shift + (from.turn * pivot - turn * pivot),
            turn,
        }
    }

    /// The pose that brings its carriers nearest to `targets`, of those that it can be in.
    fn nearest(&self, from: &Pose, targets: [DVec3; CARRIERS]) -> Pose {
        let arms = CORNERS.map(|t| self.spread * t);
        let (pivot, within) = self.pivot(from);
        let (at, free) = match self.freedom {
            Freedom::Fixed => return *from,
            Freedom::Free => (targets.iter().sum::<DVec3>() / CARRIERS as f64, true),
            Freedom::Turns(..) => (self.centre + from.shift + from.turn * pivot, false),
        };
        let mut m = DMat3::ZERO;
        for (x, r) in targets.iter().zip(arms) {
            m += outer(*x - at, r - pivot);
        }
        let turn = closest_rotation(&m, from.turn, within);
        Pose {
            shift: match free {
                true => at - self.centre,
                false => from.shift + (from.turn * pivot - turn * pivot),
            },
            turn,
        }
    }
}

/// A spring to a target at a node inside a body: which body and node, the target, stiffness and
/// limit, local units.
#[derive(Clone, Copy, Debug)]
struct InnerDraw {
    body: usize,
    node: usize,
    target: DVec3,
    stiffness: f64,
    limit: f64,
}

/// The rigid bodies of a body, whose nodes are the last of its plan and what lies beyond it.
#[derive(Clone, Debug)]
pub(super) struct RigidBodies {
    /// The first slot of any.
    pub first: usize,
    /// One after the other, a group of the plan each.
    pub bodies: Vec<Rigid>,
    /// Where each of their nodes is, from the first slot on: from its body's centre at rest.
    pub arms: Vec<DVec3>,
    /// The body of each.
    owner: Vec<u32>,
    /// Mass of each of the mesh's nodes, which its body carries for it.
    pub weights: Vec<f64>,
    /// The poses at the start of the step, those of the best and of the last trial in it.
    pub now: Vec<Pose>,
    pub best: Vec<Pose>,
    pub trial: Vec<Pose>,
    /// Shift and change of rotation from now to the last trial.
    changes: Vec<(DVec3, DMat3)>,
    /// Of the direction that is searched along: shift and rotation vector.
    pub directions: Vec<(DVec3, DVec3)>,
    /// Of the midpoint rule: the torque on each body in the last step.
    pub torques: Vec<DVec3>,
    /// Whether steps are those of that rule.
    pub midpoint: bool,
    draws: Vec<InnerDraw>,
    /// The forces of these on the carriers.
    drawn: Vec<[DVec3; CARRIERS]>,
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
        bodies: Vec<Rigid>,
        arms: Vec<DVec3>,
        weights: Vec<f64>,
    ) -> RigidBodies {
        let mut owner = vec![0; arms.len()];
        for (b, body) in bodies.iter().enumerate() {
            for slots in [&body.nodes, &body.inner] {
                owner[slots.start - first..slots.end - first].fill(b as u32);
            }
        }
        let poses = vec![Pose::REST; bodies.len()];
        RigidBodies {
            first,
            arms,
            owner,
            weights,
            now: poses.clone(),
            best: poses.clone(),
            trial: poses,
            changes: vec![(DVec3::ZERO, DMat3::ZERO); bodies.len()],
            directions: vec![(DVec3::ZERO, DVec3::ZERO); bodies.len()],
            torques: vec![DVec3::ZERO; bodies.len()],
            midpoint: false,
            draws: Vec::new(),
            drawn: vec![[DVec3::ZERO; CARRIERS]; bodies.len()],
            bodies,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// The body that has slot `i`.
    pub fn of(&self, i: usize) -> Option<usize> {
        let n = i.checked_sub(self.first)?;
        self.owner.get(n).map(|b| *b as usize)
    }

    /// The displacement of a slot from its rest in a pose of its body.
    pub fn displacement(&self, i: usize, pose: &Pose) -> DVec3 {
        let r = self.arms[i - self.first];
        pose.shift + (pose.turn * r - r)
    }

    /// Takes the poses nearest to where `at` displaces the carriers from now for a trial.
    pub fn guess<T: Real>(&mut self, at: impl Fn(usize) -> V4<T>) {
        for (b, body) in self.bodies.iter().enumerate() {
            let from = self.now[b];
            let mut targets = [DVec3::ZERO; CARRIERS];
            for (x, i) in targets.iter_mut().zip(body.carriers()) {
                let r = from.turn * self.arms[i - self.first];
                *x = body.centre + from.shift + r + wide(at(i));
            }
            self.trial[b] = body.nearest(&from, targets);
        }
        self.note_changes();
    }

    /// Stays for a trial.
    pub fn stay(&mut self) {
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
            for i in body.carriers() {
                let a = pose.turn * (self.arms[i - self.first] - pivot);
                let s = wide(vector[i]);
                sum += s;
                moment += a.cross(s);
                inertia += inertia_of(a);
            }
            let free = body.freedom == Freedom::Free;
            let shift = if free {
                sum / CARRIERS as f64
            } else {
                DVec3::ZERO
            };
            self.directions[b] = (shift, within * turned_by(inertia, moment, within));
        }
    }

    /// Goes so far along the direction from the best trial, for a trial.
    pub fn go(&mut self, length: f64) {
        for (b, body) in self.bodies.iter().enumerate() {
            let (shift, by) = self.directions[b];
            self.trial[b] = match body.freedom {
                Freedom::Fixed => self.now[b],
                _ => body.moved(&self.best[b], shift * length, by * length),
            };
        }
        self.note_changes();
    }

    fn note_changes(&mut self) {
        for (b, change) in self.changes.iter_mut().enumerate() {
            let (now, then) = (&self.now[b], &self.trial[b]);
            let turn = DMat3::from_quat(then.turn) - DMat3::from_quat(now.turn);
            *change = (then.shift - now.shift, turn);
        }
    }

    /// How far the last trial displaces slot `i` from now.
    pub fn change<T: Real>(&self, i: usize) -> V4<T> {
        let n = i - self.first;
        let (shift, turn) = &self.changes[self.owner[n] as usize];
        narrow(*shift + *turn * self.arms[n])
    }

    /// Makes the last trial the best.
    pub fn accept(&mut self) {
        std::mem::swap(&mut self.best, &mut self.trial);
    }

    /// Makes the best trial what is now.
    pub fn keep(&mut self) {
        self.now.copy_from_slice(&self.best);
    }

    /// Puts the nodes of all bodies where the `poses` have them.
    pub fn put<T: Real>(&self, poses: &[Pose], u: &mut [V4<T>]) {
        for (n, b) in self.owner.iter().enumerate() {
            let i = self.first + n;
            u[i] = narrow(self.displacement(i, &poses[*b as usize]));
        }
    }

    /// Gives the nodes of a body, or those inside only, the velocities that its carriers say.
    pub fn carry<T: Real>(&self, b: usize, all: bool, v: &mut [V4<T>]) {
        let body = &self.bodies[b];
        let carriers: [DVec3; CARRIERS] =
            std::array::from_fn(|k| wide(v[body.carriers().start + k]));
        let mean = carriers.iter().sum::<DVec3>() / CARRIERS as f64;
        let mut change = DMat3::ZERO;
        for (v, t) in carriers.iter().zip(CORNERS) {
            change += outer(*v, t);
        }
        let change = change * body.gather * (1.0 / CARRIERS as f64);
        let surface =
            body.nodes.start..body.nodes.end - if all { CARRIERS } else { body.nodes.len() };
        for i in surface.chain(body.inner.clone()) {
            v[i] = narrow(mean + change * self.arms[i - self.first]);
        }
    }

    /// Lets a body in `pose` move on with the momentum `sum`, and `moment` about its pivot, as it
    /// can: writes the velocities of its nodes.
    pub fn set_momentum<T: Real>(&self, b: usize, (sum, moment): (DVec3, DVec3), v: &mut [V4<T>]) {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, within) = body.pivot(pose);
        let mut inertia = DMat3::ZERO;
        for i in body.carriers() {
            let a = pose.turn * (self.arms[i - self.first] - pivot);
            inertia += inertia_of(a) * (body.mass / CARRIERS as f64);
        }
        let (linear, spin) = match body.freedom {
            Freedom::Free => (sum / body.mass, inertia.inverse() * moment),
            Freedom::Turns(..) => (DVec3::ZERO, turned_by(inertia, moment, within)),
            Freedom::Fixed => (DVec3::ZERO, DVec3::ZERO),
        };
        for i in body.nodes.clone().chain(body.inner.clone()) {
            let a = pose.turn * (self.arms[i - self.first] - pivot);
            v[i] = narrow(linear + spin.cross(a));
        }
    }

    /// The momentum of a body and its moment about its pivot, of its carriers' velocities.
    pub fn momentum<T: Real>(&self, b: usize, v: &[V4<T>]) -> (DVec3, DVec3) {
        let (body, pose) = (&self.bodies[b], &self.now[b]);
        let (pivot, _) = body.pivot(pose);
        let m = body.mass / CARRIERS as f64;
        let (mut sum, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for i in body.carriers() {
            let a = pose.turn * (self.arms[i - self.first] - pivot);
            sum += m * wide(v[i]);
            moment += m * a.cross(wide(v[i]));
        }
        (sum, moment)
    }

    /// Takes the poses and the momenta that suit positions and velocities of the mesh's nodes best,
    /// each by its mass; `of` gives those of a slot, local units. Writes all nodes' of the bodies.
    pub fn fit<T: Real>(
        &mut self,
        of: impl Fn(usize) -> (DVec3, DVec3),
        u: &mut [V4<T>],
        v: &mut [V4<T>],
    ) {
        for b in 0..self.bodies.len() {
            let body = &self.bodies[b];
            let surface = body.nodes.start..body.nodes.end - CARRIERS;
            let nodes = || surface.clone().chain(body.inner.clone());
            let weight = |i: usize| self.weights[i - self.first] / body.mass;
            let at: DVec3 = nodes().map(|i| weight(i) * of(i).0).sum();
            let mut m = DMat3::ZERO;
            for i in nodes() {
                m += outer(of(i).0 - at, self.arms[i - self.first]) * weight(i);
            }
            let start = crate::physics::elements::polar(&m).0;
            let start = DQuat::from_mat3(&start).normalize();
            self.now[b] = Pose {
                shift: at - body.centre,
                turn: closest_rotation(&m, start, DMat3::IDENTITY),
            };
            let (pivot, _) = body.pivot(&self.now[b]);
            let pivot = at + self.now[b].turn * pivot;
            let (mut sum, mut moment) = (DVec3::ZERO, DVec3::ZERO);
            for i in nodes() {
                let (x, v) = of(i);
                let m = self.weights[i - self.first];
                sum += m * v;
                moment += m * (x - pivot).cross(v);
            }
            self.set_momentum(b, (sum, moment), v);
        }
        self.put(&self.now, u);
    }

    /// Says which nodes of a body stay: how it can move follows. Slots.
    pub fn hold(&mut self, b: usize, held: impl Iterator<Item = usize>) {
        let near = NEAR * self.bodies[b].radius();
        let mut freedom = Freedom::Free;
        for i in held {
            let r = self.arms[i - self.first];
            freedom = match freedom {
                Freedom::Free => Freedom::Turns(r, None),
                Freedom::Turns(at, None) if r.distance(at) > near => {
                    Freedom::Turns(at, Some((r - at).normalize()))
                }
                Freedom::Turns(at, Some(axis)) if (r - at).cross(axis).length() > near => {
                    Freedom::Fixed
                }
                same => same,
            };
        }
        self.bodies[b].freedom = freedom;
    }

    /// Moves a body so that nodes of it come as near to places as they can: pairs of slots and
    /// displacements, all that stays of it among them.
    pub fn follow(&mut self, b: usize, held: &[(usize, DVec3)]) {
        let body = &self.bodies[b];
        let from = self.now[b];
        let count = held.len() as f64;
        let arm = |i: usize| self.arms[i - self.first];
        let place = |(i, u): &(usize, DVec3)| body.centre + arm(*i) + *u;
        let at = held.iter().map(place).sum::<DVec3>() / count;
        let middle = held.iter().map(|(i, _)| arm(*i)).sum::<DVec3>() / count;
        // Where they leave a turn open, it stays as it is.
        let mut m = DMat3::from_quat(from.turn) * (1e-9 * body.radius().powi(2));
        for one in held {
            m += outer(place(one) - at, arm(one.0) - middle);
        }
        let turn = closest_rotation(&m, from.turn, DMat3::IDENTITY);
        self.now[b] = Pose {
            shift: at - turn * middle - body.centre,
            turn,
        };
    }

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
pub(super) fn shares(body: &Rigid, sum: DVec3, moment: DMat3) -> [DVec3; CARRIERS] {
    let turned = moment * body.gather.transpose();
    CORNERS.map(|t| (sum + turned * t) / CARRIERS as f64)
}

/// The carriers of a body of `mass` whose sum of m r rᵀ is `second`: where they are from its
/// centre, and A. `None` where it is flat.
pub(super) fn carriers(mass: f64, second: &DMat3) -> Option<([DVec3; CARRIERS], DMat3)> {
    let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| second.col(j)[i]));
    let (values, vectors) = crate::physics::elements::eigen(rows);
    let largest = values.iter().fold(0.0f64, |a, b| a.max(*b));
    let sound = mass > 0.0 && mass.is_finite() && largest > 0.0 && largest.is_finite();
    if !sound || values.iter().any(|v| *v < 1e-10 * largest) {
        return None;
    }
    let columns: [DVec3; 3] =
        std::array::from_fn(|k| DVec3::from(vectors[k]) * (values[k] / mass).sqrt());
    let spread = DMat3::from_cols(columns[0], columns[1], columns[2]);
    Some((CORNERS.map(|t| spread * t), spread))
}

/// a bᵀ.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// |a|² I − a aᵀ.
pub(super) fn inertia_of(a: DVec3) -> DMat3 {
    DMat3::from_diagonal(DVec3::splat(a.length_squared())) - outer(a, a)
}

/// The turn that `moment` gives what has this inertia, of the turns that there are.
pub(super) fn turned_by(inertia: DMat3, moment: DVec3, within: DMat3) -> DVec3 {
    let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    let whole = within * inertia * within + (DMat3::IDENTITY - within) * trace;
    within * (whole.inverse() * (within * moment))
}

pub(super) fn wide<T: Real>(v: V4<T>) -> DVec3 {
    DVec3::new(v[0].wide(), v[1].wide(), v[2].wide())
}

pub(super) fn narrow<T: Real>(v: DVec3) -> V4<T> {
    [T::of(v.x), T::of(v.y), T::of(v.z), T::ZERO]
}
