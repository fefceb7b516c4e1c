//! Implicit Euler after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h (f + h K̃ v), then
//! v' = v + Δv and x' = x + h v'. The twin of `plain::steppers::implicit_euler`.

use super::cg::{Matrix, Outcome, Solver, Stop};
use super::coarse::Coarse;
use super::pool::{Nodes, Plan};
use super::real::Real;
use super::terms::{At, Share, Term};
use super::tied::Tied;
use super::vectors::{Columns, Symmetric, V4, add_scaled, apply, inverse, scale, total, zero};
use crate::physics::ConjugateGradients;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Solves for which a coarse space is kept, at most.
const KEPT: u32 = 30;

/// A coarse space is made anew when it takes this many times the iterations that it took at first,
/// and [`SPARE`] more.
const GROWTH: f64 = 1.3;
const SPARE: u32 = 3;

/// Blocks, inverse blocks and residual of every node, and those that are tied.
type Diagonal<'a, T> = (
    &'a [Symmetric<T>],
    &'a mut [Columns<T>],
    &'a [V4<T>],
    &'a mut Tied<T>,
);

/// The system of a step and its solver.
#[derive(Clone, Debug)]
pub struct Implicit<T> {
    /// Where conjugate gradients stop.
    pub settings: ConjugateGradients,
    /// The vectors of conjugate gradients, and the last solutions.
    pub solver: Solver<T>,
    diagonal: Vec<Symmetric<T>>,
    change: Vec<V4<T>>,
    coarse: Option<Coarse<T>>,
    /// What the coarse space was built from.
    pub basis: Basis<T>,
    /// The levels that terms act at.
    pub levels: Vec<f64>,
}

/// The state that a coarse space was built at, and how it did since.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Basis<T> {
    /// Displacements.
    pub u: Vec<V4<T>>,
    /// Length of step, local units; 0 for none.
    pub h: T,
    /// Solves since.
    pub age: u32,
    /// Iterations of the first of them.
    pub first: u32,
    /// And of the last.
    pub last: u32,
    /// Of bodies of elements: whether blocks were projected.
    pub projected: bool,
    /// And the displacements that damping was taken at, if there was any.
    pub lagged: Vec<V4<T>>,
    /// And solves left for which blocks are projected.
    pub left: u32,
    /// And where the rigid bodies were.
    pub poses: Vec<[f64; 7]>,
    /// And the levels that terms acted at.
    pub levels: Vec<f64>,
}

/// What a step goes by.
pub struct Scene<'a, T> {
    /// How the nodes are shared out.
    pub plan: &'a Plan,
    /// Masses.
    pub masses: &'a [T],
    /// 1, or 0 for nodes that stay.
    pub free: &'a [T],
    /// Rest positions.
    pub rest: &'a [V4<T>],
    /// Displacements and velocities.
    pub at: At<'a, T>,
    /// Forces.
    pub f: &'a [V4<T>],
}

impl<T: Real> Implicit<T> {
    /// For a body shared out by `plan`.
    pub fn new(plan: &Plan, settings: ConjugateGradients) -> Implicit<T> {
        Implicit {
            settings,
            solver: Solver::new(plan),
            diagonal: vec![[T::ZERO; 8]; plan.nodes()],
            change: vec![zero(); plan.nodes()],
            coarse: None,
            basis: Basis {
                u: vec![zero(); plan.nodes()],
                ..Basis::default()
            },
            levels: Vec::new(),
        }
    }

    /// Forgets the coarse space: nodes were pinned, or let go.
    pub fn forget_coarse(&mut self) {
        self.basis.h = T::ZERO;
    }

    /// Forgets also between what it couples groups of nodes, as contact does that comes and goes.
    pub fn forget_couplings(&mut self) {
        self.coarse = None;
        self.forget_coarse();
    }

    /// Forgets the solutions that the next would start from.
    pub fn forget_solutions(&mut self) {
        self.solver.count = 0;
    }

    /// Makes the coarse space that `basis` tells of, after a state was put back.
    pub fn resume(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        basis: Basis<T>,
    ) {
        self.basis = basis;
        if self.basis.h > T::ZERO {
            let u = std::mem::take(&mut self.basis.u);
            let at = At {
                u: &u,
                v: scene.at.v,
            };
            let h = self.basis.h;
            self.linearise(scene, terms, at, h);
            self.solver.tied.build(&self.diagonal, terms);
            self.build(scene, terms, &u);
            self.basis.u = u;
        }
    }

    /// Finds Δv, which is then [`Solver::solution`] until [`Solver::keep`]; local units.
    pub fn solve(&mut self, scene: &Scene<'_, T>, terms: &mut [Box<dyn Term<T>>], h: T) -> Outcome {
        self.linearise(scene, terms, scene.at, h);
        let (start, weight) = self.right_hand_side(scene, h);
        self.refresh(scene, terms, scene.at.u, h);
        let matrix = Matrix {
            plan: scene.plan,
            masses: scene.masses,
            free: scene.free,
            terms,
        };
        let stop = Stop {
            tolerance: self.settings.tolerance,
            floor: weight * (T::NEGLIGIBLE / h.wide()).powi(2),
            most: self.settings.max_iterations,
        };
        let outcome = self.solver.solve(&matrix, &mut self.coarse, start, stop);
        self.note(outcome);
        outcome
    }

    /// As [`Solver::solve_afresh`], with the coarse space.
    pub(super) fn solve_afresh(&mut self, a: &Matrix<'_, T>, start: f64, stop: Stop) -> Outcome {
        let outcome = self.solver.solve_afresh(a, &mut self.coarse, start, stop);
        self.note(outcome);
        outcome
    }

    /// Makes the coarse space anew where it is due, of what was linearised at `u`. Whether it was.
    pub(super) fn refresh(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &[Box<dyn Term<T>>],
        u: &[V4<T>],
        h: T,
    ) -> bool {
        let due = self.due(h);
        if due {
            self.basis.h = h;
            self.basis.age = 0;
            self.basis.u.copy_from_slice(u);
            self.basis.levels.clone_from(&self.levels);
            self.build(scene, terms, u);
        }
        due
    }

    /// Whether a coarse space is due to be made anew for steps of length `h`.
    fn due(&self, h: T) -> bool {
        let basis = &self.basis;
        let slow = f64::from(basis.last) > GROWTH * f64::from(basis.first) + f64::from(SPARE);
        basis.h != h || basis.age >= KEPT || slow
    }

    /// Makes the blocks of rigid bodies anew where they are due, of what was linearised.
    pub(super) fn refresh_tied(&mut self, terms: &[Box<dyn Term<T>>], h: T) {
        if self.due(h) {
            self.solver.tied.build(&self.diagonal, terms);
        }
    }

    /// Whether there is a coarse space to solve with.
    pub(super) fn has_coarse(&self) -> bool {
        self.coarse.as_ref().is_some_and(Coarse::ready)
    }

    /// The diagonal blocks, with the inverse blocks to be made of them, the residual, and what is
    /// tied.
    pub(super) fn diagonal(&mut self) -> Diagonal<'_, T> {
        let solver = &mut self.solver;
        (
            &self.diagonal,
            &mut solver.inverse,
            &solver.residual,
            &mut solver.tied,
        )
    }

    /// Takes note of how the coarse space did.
    fn note(&mut self, outcome: Outcome) {
        let basis = &mut self.basis;
        if basis.age == 0 {
            basis.first = outcome.iterations;
        }
        basis.last = outcome.iterations;
        basis.age += 1;
    }

    /// v' = v + Δv, u' = u + h v'.
    pub fn advance(&self, plan: &Plan, at: At<'_, T>, h: T, next: (&mut [V4<T>], &mut [V4<T>])) {
        let change = &self.solver.solution;
        plan.each((Nodes(next.0), Nodes(next.1)), &|_, nodes, (u, v)| {
            for (n, i) in nodes.enumerate() {
                v.0[n] = add_scaled(at.v[i], T::ONE, change[i]);
                u.0[n] = add_scaled(at.u[i], h, v.0[n]);
            }
            []
        });
    }

    pub(super) fn linearise(
        &mut self,
        scene: &Scene<'_, T>,
        terms: &mut [Box<dyn Term<T>>],
        at: At<'_, T>,
        h: T,
    ) {
        let data = (Nodes(&mut self.diagonal), Nodes(&mut self.change));
        scene.plan.each(data, &|_, nodes, (diagonal, change)| {
            change.0.fill(zero());
            for (d, m) in diagonal.0.iter_mut().zip(&scene.masses[nodes]) {
                *d = [T::ZERO; 8];
                d[..3].fill(*m);
            }
            []
        });
        for term in terms {
            let share = Share {
                diagonal: &mut self.diagonal,
                change: &mut self.change,
            };
            term.linearise(scene.plan, at, h, share);
        }
    }

    /// b = h (f + h K̃ v), and the inverse diagonal blocks D⁻¹. Returns bᵀD⁻¹b and the sum of the
    /// diagonal's means.
    fn right_hand_side(&mut self, scene: &Scene<'_, T>, h: T) -> (f64, f64) {
        let (diagonal, change) = (&self.diagonal, &self.change);
        let data = (
            Nodes(&mut self.solver.inverse),
            Nodes(&mut self.solver.residual),
        );
        let [start, weight] = scene.plan.each(data, &|_, nodes, (inverses, b)| {
            let (mut start, mut weight) = (0.0, 0.0);
            for (n, i) in nodes.enumerate() {
                if scene.free[i] == T::ZERO {
                    inverses.0[n] = [zero(); 3];
                    b.0[n] = zero();
                    continue;
                }
                let d = &diagonal[i];
                inverses.0[n] = inverse(d);
                let r = scale(h, add_scaled(scene.f[i], h, change[i]));
                b.0[n] = r;
                let z = apply(&inverses.0[n], r);
                start += total([z[0] * r[0], z[1] * r[1], z[2] * r[2], T::ZERO]);
                weight += (d[0].wide() + d[1].wide() + d[2].wide()) / 3.0;
            }
            [start, weight]
        });
        (start, weight)
    }

    fn build(&mut self, scene: &Scene<'_, T>, terms: &[Box<dyn Term<T>>], u: &[V4<T>]) {
        let coarse = self
            .coarse
            .get_or_insert_with(|| Coarse::new(scene.plan, terms));
        let point = |i: usize| {
            let (r, u) = (scene.rest[i], u[i]);
            DVec3::new(
                r[0].wide() + u[0].wide(),
                r[1].wide() + u[1].wide(),
                r[2].wide() + u[2].wide(),
            )
        };
        let free = |i: usize| scene.free[i] != T::ZERO;
        let tied = &self.solver.tied;
        coarse.build(scene.plan, point, free, &self.diagonal, terms, tied);
    }
}
