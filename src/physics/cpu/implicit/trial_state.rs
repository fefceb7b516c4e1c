//! Trial states of a step and their incremental potential.

use super::initial_guess::InitialGuesses;
use super::linear_step::StepContext;
use super::schemes::StepCoefficients;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};
use crate::physics::cpu::vectors::{V4, add, add_scaled, scale, sub, zero};

/// A displacement from the start of the step, and its potential.
#[derive(Clone, Debug)]
pub struct TrialState<T> {
    /// δ.
    pub delta: Vec<V4<T>>,
    /// x + δ.
    pub displacements: Vec<V4<T>>,
    /// w.
    pub velocities: Vec<V4<T>>,
    /// ½ |δ − δ̂|²_M / γ², and the α part.
    pub inertia: f64,
    /// E.
    pub elastic: f64,
    /// ½ γ w·D w.
    pub dissipation: f64,
}

impl<T: Real> TrialState<T> {
    /// Allocates a state for `nodes` nodes.
    pub fn new(nodes: usize) -> TrialState<T> {
        TrialState {
            delta: vec![zero(); nodes],
            displacements: vec![zero(); nodes],
            velocities: vec![zero(); nodes],
            inertia: 0.0,
            elastic: 0.0,
            dissipation: 0.0,
        }
    }

    /// Returns Φ.
    pub fn total(&self) -> f64 {
        self.inertia + self.elastic + self.dissipation
    }

    /// Returns an estimate of the rounding error of Φ.
    pub fn rounding_error(&self) -> f64 {
        T::ENERGY_ROUNDING * (self.inertia.abs() + self.elastic.abs() + self.dissipation.abs())
    }

    /// Sets free nodes to δ = `at`, nodes of rigid bodies to their last trial, and the others to
    /// where their velocities take them (zero, except for prescribed motion); computes the inertia
    /// of the free nodes.
    pub fn set_displacement(
        &mut self,
        context: &StepContext<'_, T>,
        guesses: &InitialGuesses<T>,
        (coefficients, mass_damping): (StepCoefficients, f64),
        rigid: &RigidBodies,
        at: impl Fn(usize) -> V4<T> + Sync,
    ) {
        let over = T::from_f64(1.0 / coefficients.gamma);
        let (reach, ahead) = (
            T::from_f64(coefficients.evaluation_time),
            T::from_f64(1.0 / coefficients.evaluation_time),
        );
        let data = (
            Nodes(&mut self.delta),
            Nodes(&mut self.displacements),
            Nodes(&mut self.velocities),
        );
        let [inertia, drag] =
            context
                .plan
                .for_each_chunk(data, &|_, nodes, (delta, place, speed)| {
                    let (mut inertia, mut drag) = (0.0, 0.0);
                    for (n, i) in nodes.enumerate() {
                        let free = context.free[i];
                        let prescribed_velocity = match i >= rigid.first {
                            true => scale((T::ONE - free) * ahead, rigid.change(i)),
                            false => scale(T::ONE - free, context.at.v[i]),
                        };
                        let d = match i >= rigid.first {
                            true => rigid.change(i),
                            false => add_scaled(scale(free, at(i)), reach, prescribed_velocity),
                        };
                        delta.0[n] = d;
                        place.0[n] = add(context.at.u[i], d);
                        let w =
                            add_scaled(prescribed_velocity, free * over, sub(d, guesses.base(i)));
                        speed.0[n] = w;
                        // Divided by γ before squaring: the square of a small number would be
                        // subnormal.
                        let off = scale(free * over, sub(d, guesses.goal(i)));
                        let m = context.masses[i];
                        inertia +=
                            (m * (off[0] * off[0] + off[1] * off[1] + off[2] * off[2])).to_f64();
                        drag += (m * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2])).to_f64();
                    }
                    [inertia, drag]
                });
        self.inertia = 0.5 * (inertia + mass_damping * coefficients.gamma * drag);
        self.elastic = 0.0;
        self.dissipation = 0.0;
    }

    /// Adds the energy and dissipation of the terms. `scratch` is overwritten.
    pub fn evaluate(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &[Box<dyn Term<T>>],
        lagged: &[V4<T>],
        scratch: &mut [V4<T>],
        coefficients: StepCoefficients,
    ) {
        let (place, speed) = (&self.displacements, &self.velocities);
        let [elastic, loss] =
            context
                .plan
                .for_each_chunk((Nodes(scratch), ()), &|chunk, _, (f, ())| {
                    let (mut elastic, mut loss) = (0.0, 0.0);
                    for term in terms {
                        elastic += term.energy(chunk, place);
                        if term.damped() {
                            let at = StateRef {
                                u: lagged,
                                v: speed,
                            };
                            loss += term.damping_forces(chunk, at, f.0);
                        }
                    }
                    [elastic, loss]
                });
        self.elastic = elastic;
        self.dissipation = coefficients.gamma * loss;
    }
}

/// Whether any tetrahedron is inverted at the displacements `u`.
pub fn has_inverted_tets<T: Real>(
    plan: &Partition,
    terms: &[Box<dyn Term<T>>],
    u: &[V4<T>],
) -> bool {
    let [count] = plan.for_each_chunk((), &|chunk, _, ()| {
        let any = terms.iter().any(|term| term.inverted(chunk, u));
        [f64::from(u8::from(any))]
    });
    count > 0.0
}
