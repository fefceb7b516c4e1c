//! Block Jacobi of what was linearised, where blocks may be indefinite.

use super::implicit::{Implicit, Scene};
use super::pool::{Nodes, Plan};
use super::real::Real;
use super::vectors::{apply, inverse_definite, weight as dot, zero};

impl<T: Real> Implicit<T> {
    /// Makes the inverse diagonal blocks of what was linearised. Returns rᵀD⁻¹r, the sum of the
    /// diagonal's means, and whether all blocks are positive definite.
    pub(super) fn precondition(&mut self, scene: &Scene<'_, T>) -> (f64, f64, bool) {
        let (blocks, inverses, residual) = self.diagonal();
        let data = (Nodes(inverses), ());
        let [start, weight, bad] = scene.plan.each(data, &|_, nodes, (inverses, ())| {
            let (mut start, mut weight, mut bad) = (0.0, 0.0, 0.0);
            for (n, i) in nodes.enumerate() {
                if scene.free[i] == T::ZERO {
                    inverses.0[n] = [zero(); 3];
                    continue;
                }
                let d = &blocks[i];
                let (inverse, definite) = inverse_definite(d);
                inverses.0[n] = inverse;
                if !definite {
                    bad += 1.0;
                }
                let r = residual[i];
                start += dot(r, apply(&inverse, r));
                weight += (d[0].wide() + d[1].wide() + d[2].wide()) / 3.0;
            }
            [start, weight, bad]
        });
        (start, weight, bad == 0.0)
    }

    /// rᵀD⁻¹r with the inverse blocks of the last linearisation.
    pub(super) fn measure(&self, plan: &Plan) -> f64 {
        let solver = &self.solver;
        let [sum] = plan.each((), &|_, nodes, ()| {
            let all = nodes.map(|i| {
                let r = solver.residual[i];
                dot(r, apply(&solver.inverse[i], r))
            });
            [all.sum()]
        });
        sum
    }
}
