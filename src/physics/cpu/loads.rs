//! What acts on a body from outside: gravity, forces, pins, and attachments.

use super::pool::Plan;
use super::pressure::Pressure;
use super::real::Real;
use super::vectors::{V4, add, of_metres, scale, sub, zero};
use crate::physics::Units;
use crate::{Error, Result};
use glam::DVec3;

/// What holds a node or pulls at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attachment {
    /// The node is where it is told to be, at rest.
    Hold {
        /// Which, by the file's numbers.
        node: u32,
        /// Where, m from the frame's origin.
        place: DVec3,
    },
    /// The node is at a place, and goes on from there at a velocity.
    Lead {
        /// Which, by the file's numbers.
        node: u32,
        /// Where it is now, m from the frame's origin.
        place: DVec3,
        /// m/s.
        velocity: DVec3,
    },
    /// A spring without length from the node to a target.
    Pull {
        /// Which, by the file's numbers.
        node: u32,
        /// Where to, m from the frame's origin.
        target: DVec3,
        /// N/m.
        stiffness: f64,
        /// The largest force of the spring, N.
        limit: f64,
    },
}

impl Attachment {
    /// The node.
    pub fn node(&self) -> u32 {
        match self {
            Attachment::Hold { node, .. }
            | Attachment::Lead { node, .. }
            | Attachment::Pull { node, .. } => *node,
        }
    }

    fn sound(&self) -> bool {
        match self {
            Attachment::Hold { place, .. } => place.is_finite(),
            Attachment::Lead {
                place, velocity, ..
            } => place.is_finite() && velocity.is_finite(),
            Attachment::Pull {
                target,
                stiffness,
                limit,
                ..
            } => target.is_finite() && stiffness.is_finite() && *stiffness >= 0.0 && *limit >= 0.0,
        }
    }
}

/// A spring to a target, in local units.
#[derive(Clone, Copy, Debug)]
struct Draw<T> {
    node: usize,
    /// From the node's rest position to the target.
    to: V4<T>,
    stiffness: T,
    limit: T,
}

/// Everything that acts on a body from outside, in local units and the engine's order.
#[derive(Clone, Debug)]
pub struct Loads<T> {
    gravity: V4<T>,
    forces: Vec<V4<T>>,
    forced: bool,
    draws: Vec<Draw<T>>,
    pressures: Vec<Pressure<T>>,
}

impl<T: Real> Loads<T> {
    /// Nothing, on `nodes` nodes.
    pub fn none(nodes: usize) -> Loads<T> {
        Loads {
            gravity: zero(),
            forces: vec![zero(); nodes],
            forced: false,
            draws: Vec::new(),
            pressures: Vec::new(),
        }
    }

    /// Adds a pressure.
    pub(super) fn add_pressure(&mut self, pressure: Pressure<T>) {
        self.pressures.push(pressure);
    }

    /// Takes the pressures from among all levels.
    pub fn set_levels(&mut self, levels: &[f64]) {
        self.pressures.iter_mut().for_each(|p| p.set_level(levels));
    }

    /// Sets gravity, m/s².
    pub fn set_gravity(&mut self, gravity: DVec3, units: &Units) {
        self.gravity = of_metres(gravity, units.acceleration());
    }

    /// Sets the force on every node, N, in the file's order.
    pub fn set_forces(&mut self, forces: &[DVec3], order: &[u32], units: &Units) {
        self.forced = forces.iter().any(|f| *f != DVec3::ZERO);
        for (f, v) in self.forces.iter_mut().zip(order) {
            *f = of_metres(forces[*v as usize], units.force());
        }
    }

    /// Sets the springs to targets: those of `attachments` that pull. `place` is the engine's
    /// number of every node, `rest` the rest positions in the file's order, m.
    pub fn set_draws(
        &mut self,
        attachments: &[Attachment],
        place: &[u32],
        rest: &[DVec3],
        units: &Units,
    ) {
        self.draws.clear();
        for a in attachments {
            if let Attachment::Pull {
                node,
                target,
                stiffness,
                limit,
            } = *a
            {
                self.draws.push(Draw {
                    node: place[node as usize] as usize,
                    to: of_metres(target - rest[node as usize], units.length),
                    stiffness: T::of(stiffness / units.stiffness()),
                    limit: T::of((limit / units.force()).min(1e30)),
                });
            }
        }
        self.draws.sort_by_key(|d| d.node);
    }

    /// Puts the loads on the nodes of a chunk into `f`, where springs to targets pull as they do
    /// at the displacements `u`.
    pub fn put(&self, plan: &Plan, chunk: usize, masses: &[T], u: &[V4<T>], f: &mut [V4<T>]) {
        let nodes = plan.range(chunk);
        for (f, m) in f.iter_mut().zip(&masses[nodes.clone()]) {
            *f = scale(*m, self.gravity);
        }
        if self.forced {
            for (f, e) in f.iter_mut().zip(&self.forces[nodes.clone()]) {
                *f = add(*f, *e);
            }
        }
        let from = self.draws.partition_point(|d| d.node < nodes.start);
        let mine = self.draws[from..].iter();
        for d in mine.take_while(|d| d.node < nodes.end) {
            let i = d.node - nodes.start;
            f[i] = add(f[i], d.pull(u));
        }
        for pressure in &self.pressures {
            pressure.put(chunk, nodes.start, u, f);
        }
    }
}

impl<T: Real> Loads<T> {
    /// The power of the loads on a chunk's nodes, which move with `v`.
    pub fn power(&self, plan: &Plan, chunk: usize, masses: &[T], u: &[V4<T>], v: &[V4<T>]) -> f64 {
        // Few nodes at a time, so that nothing is allocated.
        let nodes = plan.range(chunk);
        let g = self.gravity;
        let mut sum = 0.0;
        for ((v, m), f) in v
            .iter()
            .zip(&masses[nodes.clone()])
            .zip(&self.forces[nodes.clone()])
        {
            let f = add(scale(*m, g), *f);
            sum += (f[0] * v[0] + f[1] * v[1] + f[2] * v[2]).wide();
        }
        let from = self.draws.partition_point(|d| d.node < nodes.start);
        let mine = self.draws[from..].iter();
        for d in mine.take_while(|d| d.node < nodes.end) {
            let (f, v) = (d.pull(u), v[d.node - nodes.start]);
            sum += (f[0] * v[0] + f[1] * v[1] + f[2] * v[2]).wide();
        }
        let pressures = self.pressures.iter();
        sum + pressures
            .map(|p| p.power(chunk, nodes.start, u, v))
            .sum::<f64>()
    }
}

impl<T: Real> Draw<T> {
    /// The force at the displacements `u`.
    fn pull(&self, u: &[V4<T>]) -> V4<T> {
        let pull = scale(self.stiffness, sub(self.to, u[self.node]));
        let strength = (pull[0] * pull[0] + pull[1] * pull[1] + pull[2] * pull[2]).root();
        match strength > self.limit {
            true => scale(self.limit / strength, pull),
            false => pull,
        }
    }
}

/// Refuses attachments that make no sense for a body of `nodes` nodes.
///
/// # Errors
/// [`Error::Input`].
pub fn check_attachments(attachments: &[Attachment], nodes: usize) -> Result<()> {
    let strange = |a: &&Attachment| a.node() as usize >= nodes || !a.sound();
    match attachments.iter().find(strange) {
        None => Ok(()),
        Some(a) => Err(Error::Input(format!(
            "{a:?} makes no sense for a body of {nodes} nodes; give nodes that exist, finite points, and stiffness and limit of at least 0"
        ))),
    }
}
