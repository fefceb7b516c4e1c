//! The linear solve for a direction of Newton's method.

use super::linear_step::{CoarseSpaceState, LinearStepSolver, StepContext, negligible_movement};
use super::newton::{NewtonSolver, PROJECTED_SOLVES};
use super::schemes::StepCoefficients;
use crate::physics::cpu::linear::cg::{CgResult, CgTolerance, SystemOperator};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};

/// Factor on the negligible movement of a single node: a stiff body of many nodes can move although
/// no node would move noticeably by itself.
const NEGLIGIBLE_MOVEMENT_FACTOR: f64 = 0.1;

impl<T: Real> NewtonSolver<T> {
    /// Solves for the Newton direction. `None` if there is nothing to solve.
    pub(in crate::physics::cpu) fn solve(
        &mut self,
        linear_solver: &mut LinearStepSolver<T>,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coefficients: StepCoefficients,
        (first_residual, target_residual): (f64, f64),
    ) -> Option<(f64, CgResult)> {
        let gamma = T::from_f64(coefficients.gamma);
        let with_scaled_masses = StepContext {
            masses: &self.masses,
            ..*context
        };
        // The solver overwrites its right-hand side.
        self.forces.copy_from_slice(&linear_solver.solver.residual);
        loop {
            let projected = self.projected > 0;
            for term in terms.iter_mut() {
                term.set_psd_projection(projected);
            }
            let at = StateRef {
                u: &self.best.displacements,
                v: &self.best.velocities,
            };
            linear_solver.linearise(&with_scaled_masses, terms, at, gamma);
            linear_solver.refresh_rigid_projection(terms, gamma);
            let (start, diagonal_sum, definite) =
                linear_solver.build_block_jacobi(&with_scaled_masses);
            let negligible = negligible_movement(context.plan, &self.best.displacements);
            let floor = diagonal_sum * (NEGLIGIBLE_MOVEMENT_FACTOR * negligible).powi(2);
            if definite && start <= floor {
                return None;
            }
            if definite || projected {
                if linear_solver.refresh_coarse_space(
                    &with_scaled_masses,
                    terms,
                    &self.best.displacements,
                    gamma,
                ) {
                    self.record_coarse_state(&mut linear_solver.coarse_state, projected);
                }
                let matrix = SystemOperator {
                    plan: context.plan,
                    masses: &self.masses,
                    free: context.free,
                    terms: &*terms,
                };
                let stop = CgTolerance {
                    tolerance: self
                        .forcing_term(start, (first_residual, target_residual))
                        .min(0.9),
                    floor,
                    max_iterations: linear_solver.settings.max_iterations,
                };
                let outcome = linear_solver.solve_from_zero(&matrix, start, stop);
                let is_usable = !outcome.indefinite
                    && outcome.predicted_decrease > 0.0
                    && linear_solver.has_coarse();
                if is_usable || projected {
                    self.projected = self.projected.saturating_sub(1);
                    return Some((start, outcome));
                }
            }
            self.projected = PROJECTED_SOLVES;
            linear_solver.drop_coarse_space();
            linear_solver.solver.residual.copy_from_slice(&self.forces);
        }
    }

    /// Records the inputs of the coarse space, except for the displacements.
    fn record_coarse_state(&self, coarse_state: &mut CoarseSpaceState<T>, projected: bool) {
        coarse_state.projected = projected;
        coarse_state
            .damping_displacements
            .clone_from(&self.damping_displacements);
        coarse_state.poses.clear();
        let poses = self.rigid.best.iter().map(|pose| pose.to_array());
        coarse_state.poses.extend(poses);
    }

    /// Returns the relative tolerance of a solve that starts from the squared residual `start`, in
    /// a step whose first one was `first_residual`, with the goal `target_residual` (inexact Newton
    /// forcing term): closer to the minimum, the solves must be more accurate.
    fn forcing_term(&self, start: f64, (first_residual, target_residual): (f64, f64)) -> f64 {
        let max_tolerance = self.step_settings.linear_tolerance;
        let residual_ratio = if first_residual > 0.0 {
            (start / first_residual).sqrt()
        } else {
            1.0
        };
        match self.step_settings.tolerance > 0.0 {
            true => max_tolerance
                .min(residual_ratio.max(1e-6))
                .max(0.5 * (target_residual / start).sqrt()),
            false => max_tolerance,
        }
    }
}
