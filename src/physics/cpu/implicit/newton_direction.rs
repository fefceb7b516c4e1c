//! The linear solve for a direction of Newton's method.

use super::linear_step::{CoarseSpaceState, LinearStepSolver, StepContext, negligible_movement};
use super::newton::{NewtonSolver, PROJECTED_SOLVES};
use super::schemes::StepCoefficients;
use crate::physics::cpu::linear::cg::{CgResult, CgTolerance, SystemOperator};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};

/// Factor on the negligible movement of a single node: stiff bodies of many nodes can move as a
/// whole although no node alone would move noticeably.
const MIN_DIAGONAL_SHARE: f64 = 0.1;

impl<T: Real> NewtonSolver<T> {
    /// Solves for the Newton direction. `None` if there is nothing to solve.
    pub(in crate::physics::cpu) fn solve(
        &mut self,
        implicit: &mut LinearStepSolver<T>,
        scene: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        form: StepCoefficients,
        (first, goal): (f64, f64),
    ) -> Option<(f64, CgResult)> {
        let gamma = T::from_f64(form.gamma);
        let heavier = StepContext {
            masses: &self.masses,
            ..*scene
        };
        // The solver overwrites its right-hand side.
        self.forces.copy_from_slice(&implicit.solver.residual);
        loop {
            let projected = self.projected > 0;
            for term in terms.iter_mut() {
                term.set_psd_projection(projected);
            }
            let at = StateRef {
                u: &self.best.displacements,
                v: &self.best.velocities,
            };
            implicit.linearise(&heavier, terms, at, gamma);
            implicit.refresh_tied(terms, gamma);
            let (start, weight, definite) = implicit.build_block_jacobi(&heavier);
            let negligible = negligible_movement(scene.plan, &self.best.displacements);
            let floor = weight * (MIN_DIAGONAL_SHARE * negligible).powi(2);
            if definite && start <= floor {
                return None;
            }
            if definite || projected {
                if implicit.refresh(&heavier, terms, &self.best.displacements, gamma) {
                    self.note_basis(&mut implicit.basis, projected);
                }
                let matrix = SystemOperator {
                    plan: scene.plan,
                    masses: &self.masses,
                    free: scene.free,
                    terms,
                };
                let stop = CgTolerance {
                    tolerance: self.linear_tolerance(start, (first, goal)).min(0.9),
                    floor,
                    max_iterations: implicit.settings.max_iterations,
                };
                let outcome = implicit.solve_afresh(&matrix, start, stop);
                let good = !outcome.indefinite
                    && outcome.predicted_decrease > 0.0
                    && implicit.has_coarse();
                if good || projected {
                    self.projected = self.projected.saturating_sub(1);
                    return Some((start, outcome));
                }
            }
            self.projected = PROJECTED_SOLVES;
            implicit.drop_coarse_space();
            implicit.solver.residual.copy_from_slice(&self.forces);
        }
    }

    /// Notes in the state of a coarse space what it was built with besides the displacements.
    fn note_basis(&self, basis: &mut CoarseSpaceState<T>, projected: bool) {
        basis.projected = projected;
        basis
            .damping_displacements
            .clone_from(&self.damping_displacements);
        basis.poses.clear();
        let poses = self.rigid.best.iter().map(|pose| pose.to_array());
        basis.poses.extend(poses);
    }

    /// Returns the relative tolerance of a solve that starts from the squared residual `start`, in
    /// a step whose first one was `first`, with the goal `goal` (inexact Newton forcing term):
    /// closer to the minimum, the solves must be more accurate.
    fn linear_tolerance(&self, start: f64, (first, goal): (f64, f64)) -> f64 {
        let linear = self.step_settings.linear_tolerance;
        let nearer = if first > 0.0 {
            (start / first).sqrt()
        } else {
            1.0
        };
        match self.step_settings.tolerance > 0.0 {
            true => linear
                .min(nearer.max(1e-6))
                .max(0.5 * (goal / start).sqrt()),
            false => linear,
        }
    }
}
