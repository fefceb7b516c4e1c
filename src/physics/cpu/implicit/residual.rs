//! Gradient of the incremental potential.

use super::linear_step::{LinearStepSolver, StepContext};
use super::newton::NewtonSolver;
use super::schemes::StepCoefficients;
use crate::physics::cpu::partition::Nodes;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};
use crate::physics::cpu::vectors::{add, apply, dot_f64, scale, sub, zero};

impl<T: Real> NewtonSolver<T> {
    /// Writes γ² times −∇Φ into the solver's residual. Returns the squared reference value: γ²
    /// times the forces, or the momentum they change.
    pub(in crate::physics::cpu) fn residual(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &[Box<dyn Term<T>>],
        coefficients: StepCoefficients,
    ) -> f64 {
        let square = T::from_f64(coefficients.gamma * coefficients.gamma);
        let heavier = T::from_f64(self.mass_damping * coefficients.gamma);
        let (best, guesses, lagged) = (&self.best, &self.guesses, &self.damping_displacements);
        let solver = &mut linear_solver.solver;
        let rigid = &self.rigid;
        rigid.update_projection(&rigid.best, &mut solver.rigid_projection);
        let (inverses, tied) = (&solver.inverse, &solver.rigid_projection);
        let data = (Nodes(&mut solver.residual), ());
        let [pull, push] = context.plan.for_each_chunk(data, &|chunk, nodes, (b, ())| {
            let start = nodes.start;
            b.0.fill(zero());
            for term in terms {
                term.elastic_forces(chunk, &best.displacements, b.0);
                if term.damped() {
                    let at = StateRef {
                        u: lagged,
                        v: &best.velocities,
                    };
                    term.damping_forces(chunk, at, b.0);
                }
            }
            let (mut pull, mut push) = (0.0, 0.0);
            for (n, i) in nodes.enumerate() {
                let (m, free) = (context.masses[i], context.free[i]);
                let force = scale(free * square, b.0[n]);
                let goal = scale(free * m, guesses.goal(i));
                pull += dot_f64(force, apply(&inverses[i], force));
                push += dot_f64(goal, apply(&inverses[i], goal));
                let off = scale(m, sub(best.delta[i], guesses.goal(i)));
                let drag = scale(heavier * m, sub(best.delta[i], guesses.base(i)));
                b.0[n] = scale(free, sub(sub(scale(square, b.0[n]), off), drag));
            }
            for body in tied.bodies_of(context.plan, chunk) {
                let first = body.nodes().start;
                let goal = |i: usize| scale(context.masses[i], guesses.goal(i));
                let inertia = |i: usize| {
                    let off = sub(best.delta[i], guesses.goal(i));
                    let drag = scale(heavier, sub(best.delta[i], guesses.base(i)));
                    scale(context.masses[i], add(off, drag))
                };
                let force = |n: usize| add(b.0[first + n - start], inertia(first + n));
                pull += body.energy(&body.restrict(force));
                push += body.energy(&body.restrict(|n| goal(first + n)));
            }
            [pull, push]
        });
        pull.max(push)
    }
}
