//! Flexible conjugate gradients: the preconditioner, an approximate solve for linear tets, may
//! differ from one iteration to the next.

use super::block_matrix::BlockMatrix;
use super::cg::{CgResult, CgSolver, CgTolerance, SystemOperator, relative_residual};
use super::linear_tet_space::LinearTetSpace;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{add_scaled, dot_f64};

impl<T: Real> CgSolver<T> {
    /// As [`CgSolver::solve_from_zero`], with the coarse space of the linear tets.
    ///
    /// The next direction is conjugate to the last one only (Notay 2000, "Flexible conjugate
    /// gradients"): β = −α z·q / (z·r of the last iteration), with q = A p.
    pub fn solve_with_linear_tets(
        &mut self,
        a: &SystemOperator<'_, T, impl BlockMatrix<T> + ?Sized>,
        space: &mut LinearTetSpace<T>,
        start: f64,
        stop: CgTolerance,
    ) -> CgResult {
        let goal = (stop.tolerance * stop.tolerance * start).max(stop.floor);
        space.set_rigid_bodies(&self.rigid_projection);
        self.initialise(a, 0);
        let mut smooth = self.update_solution(a.plan, None, T::ZERO);
        let (mut alpha, mut before, mut iterations) = (0.0, 0.0, 0);
        let (mut gain, mut indefinite) = (0.0, false);
        // NaN counts as converged here, and is detected in the state.
        while smooth > goal && iterations < stop.max_iterations {
            if space.is_ready() && !space.solve(&self.residual) {
                indefinite = true;
                break;
            }
            let [rz, qz] = self.apply_preconditioner(a.plan, space);
            let beta = if before > 0.0 {
                -alpha * qz / before
            } else {
                0.0
            };
            before = rz;
            self.update_full_direction(a.plan, T::from_f64(beta));
            let pq = a.multiply(&self.direction, &mut self.product);
            if pq <= 0.0 {
                indefinite = true;
                break;
            }
            alpha = if pq > 0.0 { rz / pq } else { 0.0 };
            smooth = self.update_solution(a.plan, None, T::from_f64(alpha));
            gain += alpha * rz;
            iterations += 1;
            if pq.is_nan() {
                break;
            }
        }
        CgResult {
            iterations,
            residual: relative_residual(smooth, start),
            converged: smooth <= goal,
            predicted_decrease: gain,
            indefinite,
        }
    }

    /// Computes z = D⁻¹ r + P x in [`CgSolver::preconditioned`], with x from the last solve for the
    /// linear tets. Returns r·z and q·z.
    fn apply_preconditioner(&mut self, plan: &Partition, space: &LinearTetSpace<T>) -> [f64; 2] {
        let motions = &mut self.coarse_solution;
        self.rigid_projection
            .apply_inverse(&self.restricted_residuals, motions, false);
        let (r, q) = (&self.residual, &self.product);
        let (motions, rigid) = (&self.coarse_solution, &self.rigid_projection);
        let data = (Nodes(&mut self.preconditioned), ());
        plan.for_each_chunk(data, &|chunk, nodes, (z, ())| {
            let first = nodes.start;
            for body in plan.groups_of(chunk) {
                if let Some(block) = rigid.block_of_group(body) {
                    let own = block.nodes();
                    let z = &mut z.0[own.start - first..own.end - first];
                    block.update_direction(&motions[body], T::ZERO, z);
                }
            }
            let mut sums = [0.0; 2];
            for (z, i) in z.0.iter_mut().zip(nodes) {
                if space.is_ready() {
                    *z = space.add_solution(i, *z);
                }
                sums[0] += dot_f64(*z, r[i]);
                sums[1] += dot_f64(*z, q[i]);
            }
            sums
        })
    }

    /// Computes p = z + β p.
    fn update_full_direction(&mut self, plan: &Partition, beta: T) {
        let z = &self.preconditioned;
        let data = (Nodes(&mut self.direction), ());
        plan.for_each_chunk(data, &|_, nodes, (p, ())| {
            for (p, z) in p.0.iter_mut().zip(&z[nodes]) {
                *p = add_scaled(*z, beta, *p);
            }
            []
        });
    }
}
