//! Block Jacobi of what was linearised, where blocks may be indefinite.

use super::implicit::{Implicit, Scene};
use super::pool::{Nodes, Plan};
use super::real::Real;
use super::vectors::{apply, inverse_definite, weight as dot, zero};

impl<T: Real> Implicit<T> {
    /// Makes the inverse diagonal blocks of what was linearised; those of rigid bodies are there.
    /// Returns rᵀD⁻¹r, the sum of the diagonal's means, and whether all blocks are positive
    /// definite.
    pub(super) fn precondition(&mut self, scene: &Scene<'_, T>) -> (f64, f64, bool) {
        let (blocks, inverses, residual, tied) = self.diagonal();
        let data = (Nodes(inverses), ());
        let [start, weight, bad] = scene.plan.each(data, &|chunk, nodes, (inverses, ())| {
            let (mut start, mut weight, mut bad) = (0.0, 0.0, 0.0);
            for (n, i) in nodes.enumerate() {
                let d = &blocks[i];
                if scene.free[i] == T::ZERO || tied.has(i) {
                    inverses.0[n] = [zero(); 3];
                    if scene.free[i] != T::ZERO {
                        weight += (d[0].wide() + d[1].wide() + d[2].wide()) / 3.0;
                    }
                    continue;
                }
                let (inverse, definite) = inverse_definite(d);
                inverses.0[n] = inverse;
                if !definite {
                    bad += 1.0;
                }
                let r = residual[i];
                start += dot(r, apply(&inverse, r));
                weight += (d[0].wide() + d[1].wide() + d[2].wide()) / 3.0;
            }
            for body in tied.bodies_of(scene.plan, chunk) {
                let first = body.nodes().start;
                start += body.weigh(&body.restrict(|n| residual[first + n]));
            }
            [start, weight, bad]
        });
        (start, weight, bad == 0.0 && tied.sound())
    }

    /// rᵀD⁻¹r with the inverse blocks of the last linearisation.
    pub(super) fn measure(&self, plan: &Plan) -> f64 {
        let solver = &self.solver;
        let [sum] = plan.each((), &|chunk, nodes, ()| {
            let all = nodes.map(|i| {
                let r = solver.residual[i];
                dot(r, apply(&solver.inverse[i], r))
            });
            let mut sum: f64 = all.sum();
            for body in solver.tied.bodies_of(plan, chunk) {
                let first = body.nodes().start;
                sum += body.weigh(&body.restrict(|n| solver.residual[first + n]));
            }
            [sum]
        });
        sum
    }
}
