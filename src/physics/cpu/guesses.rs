//! Where Newton may start.

use super::implicit::Scene;
use super::newton::Outside;
use super::pool::Nodes;
use super::real::Real;
use super::rigid::RigidBodies;
use super::rigid_pose::narrow;
use super::rules::Form;
use super::vectors::{V4, add, add_scaled, scale, sub, zero};

/// A displacement to start from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guess {
    /// The velocity changes as it did in the last step.
    Curved,
    /// It does not.
    Straight,
    /// Nothing but what acts from outside: δ̂.
    Inert,
    /// Nothing moves.
    Still,
}

impl Guess {
    /// All of them; those that are the best most often come first.
    pub const ALL: [Guess; 4] = [Guess::Curved, Guess::Straight, Guess::Inert, Guess::Still];
}

/// The guesses of a step, and what inertia pulls to.
#[derive(Clone, Debug)]
pub struct Guesses<T> {
    /// δ̂.
    goal: Vec<V4<T>>,
    /// b.
    base: Vec<V4<T>>,
    /// Of [`Guess::Curved`].
    curved: Vec<V4<T>>,
    known: bool,
    reach: T,
}

impl<T: Real> Guesses<T> {
    /// Of so many nodes.
    pub fn new(nodes: usize) -> Guesses<T> {
        Guesses {
            goal: vec![zero(); nodes],
            base: vec![zero(); nodes],
            curved: vec![zero(); nodes],
            known: false,
            reach: T::ZERO,
        }
    }

    /// For a step from `scene`, before which velocities and displacements changed by `history`.
    pub fn prepare(
        &mut self,
        scene: &Scene<'_, T>,
        outside: Outside<'_, T>,
        history: Option<&[Vec<V4<T>>; 2]>,
        form: Form,
        rigid: &RigidBodies,
    ) {
        self.known = history.is_some() && form.bend > 0.0;
        self.reach = T::of(form.reach);
        let [gamma, back, reach, bend] =
            [form.gamma, form.history, form.reach, form.bend].map(T::of);
        let data = (
            Nodes(&mut self.goal),
            Nodes(&mut self.base),
            Nodes(&mut self.curved),
        );
        scene
            .plan
            .each(data, &|chunk, nodes, (goal, base, curved)| {
                let (masses, u) = (scene.masses, scene.at.u);
                outside.loads.put(scene.plan, chunk, masses, u, goal.0);
                for (b, body) in rigid.bodies.iter().enumerate() {
                    if nodes.contains(&body.nodes.start) {
                        rigid.load(b, nodes.start, goal.0);
                    }
                }
                for (n, i) in nodes.clone().enumerate() {
                    let mut v = scene.at.v[i];
                    base.0[n] = zero();
                    if let Some([change, moved]) = history {
                        curved.0[n] = scale(reach, add_scaled(v, bend, change[i]));
                        base.0[n] = scale(back, moved[i]);
                        v = add_scaled(v, back, change[i]);
                    }
                    let by = scale(gamma, scale(outside.inverse[i], goal.0[n]));
                    let faster = add_scaled(v, T::ONE, by);
                    goal.0[n] = add_scaled(base.0[n], gamma, faster);
                }
                for (b, body) in rigid.bodies.iter().enumerate() {
                    if rigid.midpoint && nodes.contains(&body.nodes.start) {
                        let places = rigid.aim(b, form.gamma, scene.at.v);
                        for (i, place) in body.carriers().zip(places) {
                            let goal = &mut goal.0[i - nodes.start];
                            let straight = scale(gamma, scene.at.v[i]);
                            *goal = add(sub(*goal, straight), narrow(place));
                        }
                    }
                }
                []
            });
    }

    /// Whether there is such a guess.
    pub fn has(&self, guess: Guess) -> bool {
        guess != Guess::Curved || self.known
    }

    /// Where it puts node `i`.
    #[inline(always)]
    pub fn at(&self, guess: Guess, scene: &Scene<'_, T>, i: usize) -> V4<T> {
        match guess {
            Guess::Curved => self.curved[i],
            Guess::Straight => scale(self.reach, scene.at.v[i]),
            Guess::Inert => self.goal[i],
            Guess::Still => zero(),
        }
    }

    /// δ̂ of node `i`.
    #[inline(always)]
    pub fn goal(&self, i: usize) -> V4<T> {
        self.goal[i]
    }

    /// b of node `i`.
    #[inline(always)]
    pub fn base(&self, i: usize) -> V4<T> {
        self.base[i]
    }
}
