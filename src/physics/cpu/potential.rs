//! The incremental potential of a step at one displacement: what it is, and where it was taken.

use super::guesses::Guesses;
use super::implicit::Scene;
use super::pool::{Nodes, Plan};
use super::real::Real;
use super::rigid::RigidBodies;
use super::rules::Form;
use super::terms::{At, Term};
use super::vectors::{V4, add, add_scaled, scale, sub, zero};

/// A displacement from the start of the step, and its potential.
#[derive(Clone, Debug)]
pub struct Trial<T> {
    /// δ.
    pub delta: Vec<V4<T>>,
    /// x + δ.
    pub place: Vec<V4<T>>,
    /// w.
    pub speed: Vec<V4<T>>,
    /// ½ |δ − δ̂|²_M / γ², and the part of α.
    pub inertia: f64,
    /// E.
    pub elastic: f64,
    /// ½ γ w·D w.
    pub loss: f64,
}

impl<T: Real> Trial<T> {
    /// Of so many nodes.
    pub fn new(nodes: usize) -> Trial<T> {
        Trial {
            delta: vec![zero(); nodes],
            place: vec![zero(); nodes],
            speed: vec![zero(); nodes],
            inertia: 0.0,
            elastic: 0.0,
            loss: 0.0,
        }
    }

    /// Φ.
    pub fn total(&self) -> f64 {
        self.inertia + self.elastic + self.loss
    }

    /// What Φ may be wrong by from rounding.
    pub fn slack(&self) -> f64 {
        T::ROUNDING * (self.inertia.abs() + self.elastic.abs() + self.loss.abs())
    }

    /// Puts the nodes that are free at δ = `at`, those of rigid bodies as their last trial says, and
    /// the others where their velocities take them (none, but of nodes that are led); and weighs
    /// the inertia of the free.
    pub fn put(
        &mut self,
        scene: &Scene<'_, T>,
        guesses: &Guesses<T>,
        (form, mass_damping): (Form, f64),
        rigid: &RigidBodies,
        at: impl Fn(usize) -> V4<T> + Sync,
    ) {
        let over = T::of(1.0 / form.gamma);
        let (reach, ahead) = (T::of(form.reach), T::of(1.0 / form.reach));
        let data = (
            Nodes(&mut self.delta),
            Nodes(&mut self.place),
            Nodes(&mut self.speed),
        );
        let [inertia, drag] = scene.plan.each(data, &|_, nodes, (delta, place, speed)| {
            let (mut inertia, mut drag) = (0.0, 0.0);
            for (n, i) in nodes.enumerate() {
                let free = scene.free[i];
                let led = match i >= rigid.first {
                    true => scale((T::ONE - free) * ahead, rigid.change(i)),
                    false => scale(T::ONE - free, scene.at.v[i]),
                };
                let d = match i >= rigid.first {
                    true => rigid.change(i),
                    false => add_scaled(scale(free, at(i)), reach, led),
                };
                delta.0[n] = d;
                place.0[n] = add(scene.at.u[i], d);
                let w = add_scaled(led, free * over, sub(d, guesses.base(i)));
                speed.0[n] = w;
                // Over γ before it is squared: the square of what is small would be subnormal.
                let off = scale(free * over, sub(d, guesses.goal(i)));
                let m = scene.masses[i];
                inertia += (m * (off[0] * off[0] + off[1] * off[1] + off[2] * off[2])).wide();
                drag += (m * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2])).wide();
            }
            [inertia, drag]
        });
        self.inertia = 0.5 * (inertia + mass_damping * form.gamma * drag);
        self.elastic = 0.0;
        self.loss = 0.0;
    }

    /// Adds what the terms weigh there. `scratch` may be anything after.
    pub fn weigh(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &[Box<dyn Term<T>>],
        lagged: &[V4<T>],
        scratch: &mut [V4<T>],
        form: Form,
    ) {
        let (place, speed) = (&self.place, &self.speed);
        let [elastic, loss] = scene.plan.each((Nodes(scratch), ()), &|chunk, _, (f, ())| {
            let (mut elastic, mut loss) = (0.0, 0.0);
            for term in terms {
                elastic += term.energy(chunk, place);
                if term.damped() {
                    let at = At {
                        u: lagged,
                        v: speed,
                    };
                    loss += term.resist(chunk, at, f.0);
                }
            }
            [elastic, loss]
        });
        self.elastic = elastic;
        self.loss = form.gamma * loss;
    }
}

/// Whether any tet is inside out at the displacements `u`.
pub fn inverted<T: Real>(plan: &Plan, terms: &[Box<dyn Term<T>>], u: &[V4<T>]) -> bool {
    let [count] = plan.each((), &|chunk, _, ()| {
        let any = terms.iter().any(|term| term.inverted(chunk, u));
        [f64::from(u8::from(any))]
    });
    count > 0.0
}
