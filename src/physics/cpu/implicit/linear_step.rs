//! Linearised implicit Euler step after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h (f + h K̃ v),
//! then v' = v + Δv and x' = x + h v'. The reference is `reference::integrators::implicit_euler`.

use crate::physics::CgSettings;
use crate::physics::cpu::linear::cg::{CgResult, CgSolver, CgTolerance, SystemOperator};
use crate::physics::cpu::linear::coarse_space::CoarseSpace;
use crate::physics::cpu::linear::linear_tet_nodes::LinearTetNodes;
use crate::physics::cpu::linear::linear_tet_space::LinearTetSpace;
use crate::physics::cpu::linear::rigid_projection::RigidProjection;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{
    Mat3Columns, SymMat3, V4, add_scaled, apply, inverse, scale, sum_f64, zero,
};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Residual tolerance of linear solves with contact.
const CONTACT_LINEAR_TOLERANCE: f64 = 1e-2;

/// The same for quadratic tets, whose solves take longer: accurate ones hardly save Newton iterations
/// while the contact is still changing.
const QUADRATIC_CONTACT_LINEAR_TOLERANCE: f64 = 0.1;

/// Largest number of solves with one coarse space.
const MAX_COARSE_AGE: u32 = 30;

/// The coarse space is rebuilt when the iterations exceed this multiple of those of its first solve
/// by more than [`REBUILD_ITERATION_SLACK`].
const REBUILD_ITERATION_RATIO: f64 = 1.3;
const REBUILD_ITERATION_SLACK: u32 = 3;

/// Diagonal blocks, inverse blocks and residual of every node, and the rigid projection.
type Diagonal<'a, T> = (
    &'a [SymMat3<T>],
    &'a mut [Mat3Columns<T>],
    &'a [V4<T>],
    &'a mut RigidProjection<T>,
);

/// Linear system of a step and its solver.
#[derive(Clone, Debug)]
pub struct LinearStepSolver<T> {
    /// Stopping criteria of conjugate gradients.
    pub settings: CgSettings,
    /// Vectors of conjugate gradients, and the last solutions.
    pub solver: CgSolver<T>,
    diagonal: Vec<SymMat3<T>>,
    stiffness_times_velocity: Vec<V4<T>>,
    coarse: Option<CoarseSpace<T>>,
    /// For quadratic tets, in place of [`LinearStepSolver::coarse`].
    linear_tets: Option<LinearTetSpace<T>>,
    /// State from which the coarse space was built.
    pub coarse_state: CoarseSpaceState<T>,
    /// Amplitudes of the terms.
    pub levels: Vec<f64>,
}

/// State from which a coarse space was built, and its performance since.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CoarseSpaceState<T> {
    /// Displacements.
    pub u: Vec<V4<T>>,
    /// Step length, local units; 0 for none.
    pub h: T,
    /// Number of solves since.
    pub age: u32,
    /// Iterations of the first of them.
    pub first: u32,
    /// Iterations of the last.
    pub last: u32,
    /// For bodies with elements: whether blocks were projected.
    pub projected: bool,
    /// Displacements at which damping was evaluated, if there was any.
    pub damping_displacements: Vec<V4<T>>,
    /// Remaining solves with projected blocks.
    pub projected_solves_left: u32,
    /// Poses of the rigid bodies.
    pub poses: Vec<[f64; 7]>,
    /// Amplitudes of the terms at that time.
    pub levels: Vec<f64>,
}

/// Inputs of a step.
pub struct StepContext<'a, T> {
    /// Partition of the nodes.
    pub plan: &'a Partition,
    /// Masses.
    pub masses: &'a [T],
    /// 1, or 0 for fixed nodes.
    pub free: &'a [T],
    /// Rest positions.
    pub rest: &'a [V4<T>],
    /// Displacements and velocities.
    pub at: StateRef<'a, T>,
    /// Forces.
    pub f: &'a [V4<T>],
}

/// Returns the movement per step, in local units, that the displacements `u` do not resolve: their
/// rounding error, but no more than [`Real::NEGLIGIBLE`]. A body at rest resolves any movement, so
/// that no load is too small for its first step.
pub(in crate::physics::cpu) fn negligible_movement<T: Real>(plan: &Partition, u: &[V4<T>]) -> f64 {
    let [sum] = plan.for_each_chunk((), &|_, nodes, ()| {
        let squares = u[nodes].iter().map(|u| {
            let [x, y, z] = [u[0], u[1], u[2]].map(T::to_f64);
            x * x + y * y + z * z
        });
        [squares.sum()]
    });
    let mean = (sum / plan.nodes().max(1) as f64).sqrt();
    (T::UNIT_ROUNDOFF * mean).min(T::NEGLIGIBLE)
}

impl<T: Real> LinearStepSolver<T> {
    /// Creates a solver for a body partitioned by `plan`.
    pub fn new(plan: &Partition, settings: CgSettings) -> LinearStepSolver<T> {
        LinearStepSolver {
            settings,
            solver: CgSolver::new(plan),
            diagonal: vec![[T::ZERO; 8]; plan.nodes()],
            stiffness_times_velocity: vec![zero(); plan.nodes()],
            coarse: None,
            linear_tets: None,
            coarse_state: CoarseSpaceState {
                u: vec![zero(); plan.nodes()],
                ..CoarseSpaceState::default()
            },
            levels: Vec::new(),
        }
    }

    /// Sets the coarse space of a body of quadratic tets.
    pub fn set_linear_tets(&mut self, nodes: LinearTetNodes) {
        self.linear_tets = Some(LinearTetSpace::new(nodes));
    }

    /// Returns the largest relative residual of linear solves with contact.
    pub fn contact_tolerance(&self) -> f64 {
        match self.linear_tets {
            Some(_) => QUADRATIC_CONTACT_LINEAR_TOLERANCE,
            None => CONTACT_LINEAR_TOLERANCE,
        }
    }

    /// Drops the coarse space, after the set of fixed nodes has changed.
    pub fn drop_coarse_space(&mut self) {
        self.coarse_state.h = T::ZERO;
    }

    /// Also drops the coupling pattern of the aggregates, which changes with contact.
    pub fn drop_aggregate_pattern(&mut self) {
        self.coarse = None;
        if let Some(space) = &mut self.linear_tets {
            space.drop_pattern();
        }
        self.drop_coarse_space();
    }

    /// Drops the solutions used as the initial guess of the next solve.
    pub fn clear_history(&mut self) {
        self.solver.count = 0;
    }

    /// Rebuilds the coarse space from `coarse_state` after a state was restored.
    pub fn resume(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        coarse_state: CoarseSpaceState<T>,
    ) {
        self.coarse_state = coarse_state;
        if self.coarse_state.h > T::ZERO {
            let u = std::mem::take(&mut self.coarse_state.u);
            let at = StateRef {
                u: &u,
                v: context.at.v,
            };
            let h = self.coarse_state.h;
            self.linearise(context, terms, at, h);
            self.solver.rigid_projection.build(&self.diagonal, terms);
            self.build_coarse_space(context, terms, &u);
            self.coarse_state.u = u;
        }
    }

    /// Solves for Δv, available as [`CgSolver::solution`] until [`CgSolver::store_solution`]; local
    /// units.
    pub fn solve(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        h: T,
    ) -> CgResult {
        self.linearise(context, terms, context.at, h);
        let (start, weight) = self.right_hand_side(context, h);
        self.refresh_coarse_space(context, terms, context.at.u, h);
        let matrix = SystemOperator {
            plan: context.plan,
            masses: context.masses,
            free: context.free,
            terms,
        };
        let stop = CgTolerance {
            tolerance: self.settings.tolerance,
            floor: weight * (negligible_movement(context.plan, context.at.u) / h.to_f64()).powi(2),
            max_iterations: self.settings.max_iterations,
        };
        let outcome = self.solver.solve(&matrix, &mut self.coarse, start, stop);
        self.record_result(outcome);
        outcome
    }

    /// As [`CgSolver::solve_from_zero`], with the coarse space.
    pub(in crate::physics::cpu) fn solve_from_zero(
        &mut self,
        a: &SystemOperator<'_, T>,
        start: f64,
        stop: CgTolerance,
    ) -> CgResult {
        let outcome = match &mut self.linear_tets {
            Some(space) => self.solver.solve_with_linear_tets(a, space, start, stop),
            None => self
                .solver
                .solve_from_zero(a, &mut self.coarse, start, stop),
        };
        self.record_result(outcome);
        outcome
    }

    /// Rebuilds the coarse space from the linearisation at `u` if it is stale. Returns whether it
    /// was rebuilt.
    pub(in crate::physics::cpu) fn refresh_coarse_space(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &[Box<dyn Term<T>>],
        u: &[V4<T>],
        h: T,
    ) -> bool {
        let is_stale = self.coarse_is_stale(h);
        if is_stale {
            self.coarse_state.h = h;
            self.coarse_state.age = 0;
            self.coarse_state.u.copy_from_slice(u);
            self.coarse_state.levels.clone_from(&self.levels);
            self.build_coarse_space(context, terms, u);
        }
        is_stale
    }

    /// Whether the coarse space must be rebuilt for steps of length `h`.
    fn coarse_is_stale(&self, h: T) -> bool {
        let coarse_state = &self.coarse_state;
        let slow = f64::from(coarse_state.last)
            > REBUILD_ITERATION_RATIO * f64::from(coarse_state.first)
                + f64::from(REBUILD_ITERATION_SLACK);
        coarse_state.h != h || coarse_state.age >= MAX_COARSE_AGE || slow
    }

    /// Rebuilds the blocks of rigid bodies from the linearisation if they are stale.
    pub(in crate::physics::cpu) fn refresh_rigid_projection(
        &mut self,
        terms: &[Box<dyn Term<T>>],
        h: T,
    ) {
        if self.coarse_is_stale(h) {
            self.solver.rigid_projection.build(&self.diagonal, terms);
        }
    }

    /// Whether there is a factorised coarse space.
    pub(in crate::physics::cpu) fn has_coarse(&self) -> bool {
        match &self.linear_tets {
            Some(space) => space.is_ready(),
            None => self.coarse.as_ref().is_some_and(CoarseSpace::is_factorised),
        }
    }

    /// Returns the diagonal blocks, the inverse blocks to compute, the residual, and the rigid
    /// projection.
    pub(in crate::physics::cpu) fn diagonal(&mut self) -> Diagonal<'_, T> {
        let solver = &mut self.solver;
        (
            &self.diagonal,
            &mut solver.inverse,
            &solver.residual,
            &mut solver.rigid_projection,
        )
    }

    /// Records the performance of the coarse space.
    fn record_result(&mut self, outcome: CgResult) {
        let coarse_state = &mut self.coarse_state;
        if coarse_state.age == 0 {
            coarse_state.first = outcome.iterations;
        }
        coarse_state.last = outcome.iterations;
        coarse_state.age += 1;
    }

    /// Computes v' = v + Δv, u' = u + h v'.
    pub fn advance(
        &self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        next: (&mut [V4<T>], &mut [V4<T>]),
    ) {
        let velocity_change = &self.solver.solution;
        plan.for_each_chunk((Nodes(next.0), Nodes(next.1)), &|_, nodes, (u, v)| {
            for (n, i) in nodes.enumerate() {
                v.0[n] = add_scaled(at.v[i], T::ONE, velocity_change[i]);
                u.0[n] = add_scaled(at.u[i], h, v.0[n]);
            }
            []
        });
    }

    pub(in crate::physics::cpu) fn linearise(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        at: StateRef<'_, T>,
        h: T,
    ) {
        let data = (
            Nodes(&mut self.diagonal),
            Nodes(&mut self.stiffness_times_velocity),
        );
        context
            .plan
            .for_each_chunk(data, &|_, nodes, (diagonal, stiffness_velocity)| {
                stiffness_velocity.0.fill(zero());
                for (d, m) in diagonal.0.iter_mut().zip(&context.masses[nodes]) {
                    *d = [T::ZERO; 8];
                    d[..3].fill(*m);
                }
                []
            });
        for term in terms {
            let contribution = SystemContribution {
                diagonal: &mut self.diagonal,
                stiffness_velocity: &mut self.stiffness_times_velocity,
            };
            term.linearise(context.plan, at, h, contribution);
        }
    }

    /// Computes b = h (f + h K̃ v) and the inverse diagonal blocks D⁻¹. Returns bᵀD⁻¹b and the sum
    /// of the diagonal's means.
    fn right_hand_side(&mut self, context: &StepContext<'_, T>, h: T) -> (f64, f64) {
        let (diagonal, stiffness_velocity) = (&self.diagonal, &self.stiffness_times_velocity);
        let data = (
            Nodes(&mut self.solver.inverse),
            Nodes(&mut self.solver.residual),
        );
        let [start, weight] = context
            .plan
            .for_each_chunk(data, &|_, nodes, (inverses, b)| {
                let (mut start, mut weight) = (0.0, 0.0);
                for (n, i) in nodes.enumerate() {
                    if context.free[i] == T::ZERO {
                        inverses.0[n] = [zero(); 3];
                        b.0[n] = zero();
                        continue;
                    }
                    let d = &diagonal[i];
                    inverses.0[n] = inverse(d);
                    let r = scale(h, add_scaled(context.f[i], h, stiffness_velocity[i]));
                    b.0[n] = r;
                    let z = apply(&inverses.0[n], r);
                    start += sum_f64([z[0] * r[0], z[1] * r[1], z[2] * r[2], T::ZERO]);
                    weight += (d[0].to_f64() + d[1].to_f64() + d[2].to_f64()) / 3.0;
                }
                [start, weight]
            });
        (start, weight)
    }

    fn build_coarse_space(
        &mut self,
        context: &StepContext<'_, T>,
        terms: &[Box<dyn Term<T>>],
        u: &[V4<T>],
    ) {
        let point = |i: usize| {
            let (r, u) = (context.rest[i], u[i]);
            DVec3::new(
                r[0].to_f64() + u[0].to_f64(),
                r[1].to_f64() + u[1].to_f64(),
                r[2].to_f64() + u[2].to_f64(),
            )
        };
        let free = |i: usize| context.free[i] != T::ZERO;
        let rigid_projection = &self.solver.rigid_projection;
        if let Some(space) = &mut self.linear_tets {
            space.factorise(point, free, &self.diagonal, terms, rigid_projection);
            return;
        }
        let coarse = self
            .coarse
            .get_or_insert_with(|| CoarseSpace::new(context.plan, terms));
        coarse.factorise(
            context.plan,
            point,
            free,
            &self.diagonal,
            terms,
            rigid_projection,
        );
    }
}
