//! Preconditioned conjugate gradients with one 3-vector per node: block Jacobi plus an additive
//! coarse correction.

use super::block_matrix::BlockMatrix;
use super::coarse_space::CoarseSpace;
use super::rigid_modes::prolong;
use super::rigid_projection::RigidProjection;
use super::sparse_cholesky::Vec6Padded;
use crate::physics::cpu::partition::{Groups, Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{
    Mat3Columns, V4, add, add_scaled, apply, dot, dot_f64, scale, sum_f64, zero,
};

/// The system matrix A.
pub struct SystemOperator<'a, T, M: ?Sized = [Box<dyn Term<T>>]> {
    /// Partition of the nodes.
    pub plan: &'a Partition,
    /// Masses, on the diagonal in addition to the terms.
    pub masses: &'a [T],
    /// 1, or 0 for fixed nodes, whose rows are zero.
    pub free: &'a [T],
    /// Linearised terms.
    pub terms: &'a M,
}

impl<T: Real, M: BlockMatrix<T> + ?Sized> SystemOperator<'_, T, M> {
    /// Computes y = A p, for p that is zero at fixed nodes. Returns p·y.
    pub fn multiply(&self, p: &[V4<T>], y: &mut [V4<T>]) -> f64 {
        let [sum] = self
            .plan
            .for_each_chunk((Nodes(y), ()), &|chunk, nodes, (y, ())| {
                let p_here = &p[nodes.clone()];
                for ((y, p), m) in y.0.iter_mut().zip(p_here).zip(&self.masses[nodes.clone()]) {
                    *y = scale(*m, *p);
                }
                self.terms.multiply(chunk, p, y.0);
                for (y, free) in y.0.iter_mut().zip(&self.free[nodes]) {
                    *y = [*free * y[0], *free * y[1], *free * y[2], T::ZERO];
                }
                [dot(p_here, y.0)]
            });
        sum
    }
}

/// Stopping criteria of conjugate gradients.
#[derive(Clone, Copy, Debug)]
pub struct CgTolerance {
    /// Target relative residual √(rᵀD⁻¹r / bᵀD⁻¹b).
    pub tolerance: f64,
    /// Negligible rᵀD⁻¹r.
    pub floor: f64,
    /// Largest number of iterations.
    pub max_iterations: u32,
}

/// Result of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CgResult {
    /// Iterations.
    pub iterations: u32,
    /// The relative residual.
    pub residual: f64,
    /// Whether the target residual was reached.
    pub converged: bool,
    /// For [`CgSolver::solve_from_zero`]: b·x, twice the decrease of ½xᵀAx − bᵀx.
    pub predicted_decrease: f64,
    /// For [`CgSolver::solve_from_zero`]: whether it stopped because the matrix is not positive
    /// definite.
    pub indefinite: bool,
}

/// Vectors of conjugate gradients, and the solutions of the last two systems.
#[derive(Clone, Debug)]
pub struct CgSolver<T> {
    /// Inverse diagonal blocks; zero for fixed nodes.
    pub inverse: Vec<Mat3Columns<T>>,
    /// b, then the residual.
    pub residual: Vec<V4<T>>,
    /// The solution.
    pub solution: Vec<V4<T>>,
    /// The last solution and the one before.
    pub previous_solutions: [Vec<V4<T>>; 2],
    /// Number of previous solutions available.
    pub count: usize,
    pub(super) direction: Vec<V4<T>>,
    pub(super) product: Vec<V4<T>>,
    /// D⁻¹ r.
    pub(super) preconditioned: Vec<V4<T>>,
    other: Vec<V4<T>>,
    pub(super) coarse_solution: Vec<Vec6Padded<T>>,
    pub(super) restricted_residuals: Vec<Vec6Padded<T>>,
    /// Nodes of rigid bodies, which move together.
    pub rigid_projection: RigidProjection<T>,
}

impl<T: Real> CgSolver<T> {
    /// Creates a solver for a body partitioned by `plan`.
    pub fn new(plan: &Partition) -> CgSolver<T> {
        let vector = || vec![zero(); plan.nodes()];
        CgSolver {
            inverse: vec![[zero(); 3]; plan.nodes()],
            residual: vector(),
            solution: vector(),
            previous_solutions: [vector(), vector()],
            count: 0,
            direction: vector(),
            product: vector(),
            preconditioned: vector(),
            other: vector(),
            coarse_solution: vec![[T::ZERO; 8]; plan.groups()],
            restricted_residuals: vec![[T::ZERO; 8]; plan.groups()],
            rigid_projection: RigidProjection::empty(),
        }
    }

    /// Solves A x = b, with b in [`CgSolver::residual`] and bᵀD⁻¹b = `start`; writes x into
    /// [`CgSolver::solution`].
    pub fn solve(
        &mut self,
        a: &SystemOperator<'_, T, impl BlockMatrix<T> + ?Sized>,
        coarse: &mut Option<CoarseSpace<T>>,
        start: f64,
        stop: CgTolerance,
    ) -> CgResult {
        self.initialise(a, self.count);
        self.iterate(a, coarse, start, stop, false)
    }

    /// As [`CgSolver::solve`], from zero, for a matrix that may be indefinite; stops if it finds a
    /// direction of non-positive curvature.
    pub fn solve_from_zero(
        &mut self,
        a: &SystemOperator<'_, T, impl BlockMatrix<T> + ?Sized>,
        coarse: &mut Option<CoarseSpace<T>>,
        start: f64,
        stop: CgTolerance,
    ) -> CgResult {
        self.initialise(a, 0);
        self.iterate(a, coarse, start, stop, true)
    }

    fn iterate(
        &mut self,
        a: &SystemOperator<'_, T, impl BlockMatrix<T> + ?Sized>,
        coarse: &mut Option<CoarseSpace<T>>,
        start: f64,
        stop: CgTolerance,
        may_be_indefinite: bool,
    ) -> CgResult {
        let goal = (stop.tolerance * stop.tolerance * start).max(stop.floor);
        let mut coarse = coarse.as_mut().filter(|c| c.is_factorised());
        let mut smooth = self.update_solution(a.plan, coarse.as_deref(), T::ZERO);
        let (mut before, mut iterations) = (0.0, 0);
        let (mut gain, mut indefinite) = (0.0, false);
        // NaN counts as converged here, and is detected in the state.
        while smooth > goal && iterations < stop.max_iterations {
            let rz = smooth + self.apply_coarse_correction(&mut coarse);
            let beta = if before > 0.0 { rz / before } else { 0.0 };
            before = rz;
            self.update_direction(a.plan, coarse.as_deref(), T::from_f64(beta));
            let pq = a.multiply(&self.direction, &mut self.product);
            if may_be_indefinite && pq <= 0.0 {
                indefinite = true;
                break;
            }
            // The matrix is positive definite; if rounding makes the curvature non-positive, do not
            // move.
            let alpha = if pq > 0.0 { rz / pq } else { 0.0 };
            smooth = self.update_solution(a.plan, coarse.as_deref(), T::from_f64(alpha));
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

    /// Returns rᵀD⁻¹r, where D includes the blocks of the rigid bodies.
    pub fn preconditioned_norm_squared(&self, plan: &Partition) -> f64 {
        let [sum] = plan.for_each_chunk((), &|chunk, nodes, ()| {
            let all = nodes.map(|i| {
                let r = self.residual[i];
                dot_f64(r, apply(&self.inverse[i], r))
            });
            let mut sum: f64 = all.sum();
            for body in self.rigid_projection.bodies_of(plan, chunk) {
                let first = body.nodes().start;
                sum += body.energy(&body.restrict(|n| self.residual[first + n]));
            }
            [sum]
        });
        sum
    }

    /// Keeps the solution for the initial guess of the next solve.
    pub fn store_solution(&mut self) {
        self.previous_solutions.rotate_right(1);
        std::mem::swap(&mut self.previous_solutions[0], &mut self.solution);
        self.count = (self.count + 1).min(2);
    }

    /// Sets the initial guess that minimises ½xᵀAx − bᵀx in the span of the last two solutions.
    ///
    /// It is at least as good as zero, the last solution, or their linear extrapolation.
    pub(super) fn initialise(
        &mut self,
        a: &SystemOperator<'_, T, impl BlockMatrix<T> + ?Sized>,
        count: usize,
    ) {
        let [last, older] = &self.previous_solutions;
        let mut weights = [0.0; 2];
        if count > 0 {
            let aa = a.multiply(last, &mut self.product);
            let ab = dot(last, &self.residual);
            if aa > 0.0 {
                weights[0] = ab / aa;
            }
            if count > 1 {
                let oo = a.multiply(older, &mut self.other);
                let ob = dot(older, &self.residual);
                let ao = dot(last, &self.other);
                let determinant = aa * oo - ao * ao;
                if determinant > 1e-6 * aa * oo {
                    weights[0] = (ab * oo - ob * ao) / determinant;
                    weights[1] = (ob * aa - ab * ao) / determinant;
                }
            }
        }
        let [s, t] = weights.map(T::from_f64);
        let (product, other) = (&self.product, &self.other);
        let data = (
            Nodes(&mut self.solution),
            Nodes(&mut self.residual),
            Nodes(&mut self.direction),
        );
        a.plan.for_each_chunk(data, &|_, nodes, (x, r, p)| {
            p.0.fill(zero());
            x.0.fill(zero());
            for (n, i) in nodes.enumerate() {
                if count > 0 {
                    x.0[n] = add_scaled(x.0[n], s, last[i]);
                    r.0[n] = add_scaled(r.0[n], -s, product[i]);
                }
                if count > 1 {
                    x.0[n] = add_scaled(x.0[n], t, older[i]);
                    r.0[n] = add_scaled(r.0[n], -t, other[i]);
                }
            }
            []
        });
        self.product.fill(zero());
    }

    /// Computes x += α p, r −= α A p, and the restriction of r to the coarse space and the rigid
    /// bodies. Returns rᵀD⁻¹r, where D includes the blocks of the rigid bodies.
    pub(super) fn update_solution(
        &mut self,
        plan: &Partition,
        coarse: Option<&CoarseSpace<T>>,
        alpha: T,
    ) -> f64 {
        let (p, q, inverse) = (&self.direction, &self.product, &self.inverse);
        let rigid_projection = &self.rigid_projection;
        let data = (
            Nodes(&mut self.solution),
            Nodes(&mut self.residual),
            Nodes(&mut self.preconditioned),
            Groups(&mut self.restricted_residuals),
        );
        let step = alpha.splat();
        let [sum] = plan.for_each_chunk(data, &|chunk, nodes, (x, r, z, restricted_residuals)| {
            let mut sum = 0.0;
            for (g, force) in plan.groups_of(chunk).zip(restricted_residuals.0) {
                let here = plan.group(g);
                let mine = here.start - nodes.start..here.end - nodes.start;
                let (x, r) = (&mut x.0[mine.clone()], &mut r.0[mine.clone()]);
                let (z, first) = (&mut z.0[mine], here.start);
                let steps = p[here.clone()].iter().zip(&q[here.clone()]);
                let mut lanes = T::ZERO.splat();
                let state = x.iter_mut().zip(&mut *r).zip(z);
                for (((x, r), z), ((p, q), m)) in state.zip(steps.zip(&inverse[here])) {
                    *x = T::array(T::lanes(x) + step * T::lanes(p));
                    let rest = T::lanes(r) - step * T::lanes(q);
                    *r = T::array(rest);
                    let smooth = (T::lanes(&m[0]) * r[0].splat() + T::lanes(&m[1]) * r[1].splat())
                        + T::lanes(&m[2]) * r[2].splat();
                    *z = T::array(smooth);
                    lanes = lanes + smooth * rest;
                }
                sum += sum_f64(T::array(lanes));
                if let Some(body) = rigid_projection.block_of_group(g) {
                    *force = body.restrict(|n| r[n]);
                    sum += body.energy(force);
                } else if let Some(coarse) = coarse {
                    *force = coarse.restrict(first, r);
                }
            }
            [sum]
        });
        sum
    }

    /// Applies the coarse correction and the inverse blocks of the rigid bodies to the restricted
    /// forces. Returns the coarse part of r·z, which is not in rᵀD⁻¹r.
    fn apply_coarse_correction(&mut self, coarse: &mut Option<&mut CoarseSpace<T>>) -> f64 {
        let Some(coarse) = coarse else {
            self.rigid_projection.apply_inverse(
                &self.restricted_residuals,
                &mut self.coarse_solution,
                false,
            );
            return 0.0;
        };
        self.coarse_solution
            .copy_from_slice(&self.restricted_residuals);
        self.rigid_projection
            .remove_constrained_forces(&mut self.coarse_solution);
        coarse.solve(&mut self.coarse_solution);
        let mut sum = 0.0;
        for (f, m) in self.restricted_residuals.iter().zip(&self.coarse_solution) {
            for k in 0..6 {
                sum += (f[k] * m[k]).to_f64();
            }
        }
        self.rigid_projection.apply_inverse(
            &self.restricted_residuals,
            &mut self.coarse_solution,
            true,
        );
        sum
    }

    /// Updates the direction p = z + β p.
    fn update_direction(&mut self, plan: &Partition, coarse: Option<&CoarseSpace<T>>, beta: T) {
        let (smoothed, coarse_solution, rigid_projection) = (
            &self.preconditioned,
            &self.coarse_solution,
            &self.rigid_projection,
        );
        plan.for_each_chunk(
            (Nodes(&mut self.direction), ()),
            &|chunk, nodes, (p, ())| {
                for g in plan.groups_of(chunk) {
                    let here = plan.group(g);
                    let p = &mut p.0[here.start - nodes.start..here.end - nodes.start];
                    let (z, first) = (&smoothed[here.clone()], here.start);
                    if let Some(body) = rigid_projection.block_of_group(g) {
                        body.update_direction(&coarse_solution[g], beta, p);
                        continue;
                    }
                    match coarse {
                        None => {
                            for (p, z) in p.iter_mut().zip(z) {
                                *p = add_scaled(*z, beta, *p);
                            }
                        }
                        Some(coarse) => {
                            let motion = &coarse_solution[g];
                            for ((p, z), a) in p.iter_mut().zip(z).zip(coarse.lever_arms(first)) {
                                *p = add_scaled(add(*z, prolong(a, motion)), beta, *p);
                            }
                        }
                    }
                }
                []
            },
        );
    }
}

/// Returns √(rᵀD⁻¹r / bᵀD⁻¹b) from its squares; 0 for b = 0.
pub(super) fn relative_residual(squared: f64, start: f64) -> f64 {
    match start > 0.0 {
        true => (squared / start).sqrt(),
        false => 0.0,
    }
}
