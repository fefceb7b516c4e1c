//! Block Jacobi preconditioner of the linearised system, whose blocks may be indefinite.

use super::linear_step::{LinearStepSolver, StepContext};
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{SymMat3, apply, dot_f64 as dot, inverse_definite, zero};

impl<T: Real> LinearStepSolver<T> {
    /// Inverts the linearised diagonal blocks, except those of rigid bodies, which exist already.
    /// Returns rᵀD⁻¹r; the number of nodes times the harmonic mean of the diagonal, so that stiff
    /// parts do not hide soft ones; and whether all blocks are positive definite.
    pub(in crate::physics::cpu) fn build_block_jacobi(
        &mut self,
        context: &StepContext<'_, T>,
    ) -> (f64, f64, bool) {
        let (blocks, inverses, residual, rigid_projection) = self.diagonal();
        let data = (Nodes(inverses), ());
        let [start, gives, count, bad] =
            context
                .plan
                .for_each_chunk(data, &|chunk, nodes, (inverses, ())| {
                    let (mut start, mut gives, mut count, mut bad) = (0.0, 0.0, 0.0, 0.0);
                    let mut weigh = |d: &SymMat3<T>| {
                        let mean = (d[0].to_f64() + d[1].to_f64() + d[2].to_f64()) / 3.0;
                        if mean > 0.0 {
                            gives += 1.0 / mean;
                            count += 1.0;
                        }
                    };
                    for (n, i) in nodes.enumerate() {
                        let d = &blocks[i];
                        if context.free[i] == T::ZERO || rigid_projection.contains(i) {
                            inverses.0[n] = [zero(); 3];
                            if context.free[i] != T::ZERO {
                                weigh(d);
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
                        weigh(d);
                    }
                    for body in rigid_projection.bodies_of(context.plan, chunk) {
                        let first = body.nodes().start;
                        start += body.energy(&body.restrict(|n| residual[first + n]));
                    }
                    [start, gives, count, bad]
                });
        let weight = count * count / f64::max(gives, f64::MIN_POSITIVE);
        (
            start,
            weight,
            bad == 0.0 && rigid_projection.is_positive_definite(),
        )
    }

    /// Returns rᵀD⁻¹r with the inverse blocks of the last linearisation.
    pub(in crate::physics::cpu) fn preconditioned_norm_squared(&self, plan: &Partition) -> f64 {
        self.solver.preconditioned_norm_squared(plan)
    }
}
