//! The exact tangent of the forces of a body at its state, and solves with it: of a body at rest,
//! or of an implicit step.
//!
//! A = M/h² + D/h + K, with K the derivative of the forces of all terms: element Hessians without
//! projection, the exact Hessian of self-contact, the rotation of the forces on rigid bodies and,
//! at rest, the loads' own tangents. A body at rest has an h so large that only K is left.
//! Conjugate gradients solve with the part that terms linearise, which is symmetric; flexible GMRES
//! corrects for the rest.

use super::CpuBody;
use crate::physics::CgSettings;
use crate::physics::cpu::contact::contact_derivatives::PairTangent;
use crate::physics::cpu::contact::friction_derivatives::FrictionTangent;
use crate::physics::cpu::implicit::contact_terms::{self_contact, tool_contact};
use crate::physics::cpu::implicit::linear_step::{LinearStepSolver, StepContext};
use crate::physics::cpu::linear::cg::{CgTolerance, SystemOperator};
use crate::physics::cpu::linear::flexible_gmres::flexible_gmres;
use crate::physics::cpu::runtime::static_adjoint::TangentParts;
use crate::physics::cpu::springs::term::Springs;
use crate::physics::cpu::term::{StateRef, find_term};
use crate::physics::cpu::vectors::{V4, add, add_scaled, outer, scale, sub, to_dvec, to_v4, zero};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Length of the step of the linearisation of a body at rest, in which inertia and damping are
/// below rounding. A power of 2, so that the division by h² is exact.
pub(super) const STATIC_STEP: f64 = (1u64 << 60) as f64;

/// Relative residual of the adjoint solve, and the largest that is accepted. Larger than that of conjugate
/// gradients, so that one of their solves suffices where the matrix is exact.
const TOLERANCE: f64 = 1e-11;
const ACCEPTED_RESIDUAL: f64 = 1e-8;

/// Relative residual of conjugate gradients, if the matrix is exact and if GMRES corrects it.
const EXACT_TOLERANCE: f64 = 1e-12;
const CORRECTED_TOLERANCE: f64 = 1e-4;

/// Largest number of conjugate gradient solves, and of the iterations of one.
const MAX_SOLVES: usize = 200;
const MAX_ITERATIONS: u32 = 100_000;

/// The tangent of a body at its state.
pub(super) struct Tangent {
    /// Length of the step, local units.
    pub step: f64,
    /// Masses of every node of the plan: 0 at rest.
    pub masses: Vec<f64>,
    solver: LinearStepSolver<f64>,
    /// Exact Hessians of self-contact less the linearised ones.
    pairs: Vec<PairTangent>,
    /// Friction of a step.
    pub friction: Vec<FrictionTangent>,
    /// Exact blocks of springs less the linearised ones.
    springs: Vec<([u32; 2], DMat3)>,
    /// For each rigid body: the Hessian by its rotation of the work of constant forces.
    rotations: Vec<DMat3>,
    /// 0 and 1 for every node of the plan.
    zeros: Vec<f64>,
    ones: Vec<f64>,
    has_loads: bool,
    /// Whether conjugate gradients solve with all of it.
    is_exact: bool,
    /// Iterations of conjugate gradients.
    pub iterations: u32,
}

/// What a linearisation needs besides the displacements.
#[derive(Clone, Copy)]
pub(super) struct Forces<'a> {
    /// All forces on the nodes of rigid bodies.
    pub net: &'a [V4<f64>],
    /// Velocities at which friction acts.
    pub velocities: &'a [V4<f64>],
}

impl CpuBody<f64> {
    /// Returns the derivatives of friction at the displacements of the body.
    fn friction_tangents(&self, v: &[V4<f64>]) -> Vec<FrictionTangent> {
        let at = StateRef {
            u: &self.state.u[..],
            v,
        };
        let mut all = tool_contact(&self.terms).map_or(Vec::new(), |c| c.friction_tangents(at));
        if let Some(own) = self_contact(&self.terms) {
            all.extend(own.friction_tangents(at));
        }
        all
    }

    /// Linearises the forces at the current state.
    pub(super) fn linearise_exactly(
        &mut self,
        parts: TangentParts,
        (step, masses): (f64, Vec<f64>),
        Forces { net, velocities }: Forces<'_>,
    ) -> Tangent {
        let nodes = self.plan.nodes();
        let rigid = self.newton.as_ref().map(|newton| &newton.rigid);
        let mut solver = match &self.implicit {
            Some(solver) => solver.clone(),
            None => LinearStepSolver::new(&self.plan, CgSettings::default()),
        };
        if let Some(rigid) = rigid {
            rigid.update_projection(&rigid.now, &mut solver.solver.rigid_projection);
        }
        solver.drop_aggregate_pattern();
        let context = StepContext {
            plan: &self.plan,
            masses: &masses,
            free: &self.free_mask,
            rest: &self.rest_local,
            at: StateRef {
                u: &self.state.u,
                v: velocities,
            },
            f: &self.state.f,
        };
        for term in &mut self.terms {
            term.set_psd_projection(!parts.unprojected);
        }
        solver.linearise(&context, &mut self.terms, context.at, step);
        solver.refresh_rigid_projection(&self.terms, step);
        solver.refresh_coarse_space(&context, &self.terms, context.at.u, step);
        let mut pairs = self_contact(&self.terms)
            .filter(|_| parts.pairs)
            .map_or(Vec::new(), |term| term.tangent_corrections(&self.state.u));
        let friction = match step < STATIC_STEP {
            true => self.friction_tangents(velocities),
            false => Vec::new(),
        };
        let with_positions = parts.friction;
        pairs.extend(friction.iter().map(|f| f.correction(step, with_positions)));
        let springs: Option<&Springs<f64>> = find_term(&self.terms).filter(|_| parts.unprojected);
        let springs = springs.map_or(Vec::new(), |s| s.tangent_corrections(&self.state.u));
        let rotations = match parts.rotations {
            true => self.rotation_tangents(net),
            false => Vec::new(),
        };
        let has_loads = parts.loads && self.loads.has_tangent();
        Tangent {
            is_exact: pairs.is_empty() && springs.is_empty() && rotations.is_empty() && !has_loads,
            has_loads,
            step,
            masses,
            solver,
            pairs,
            friction,
            springs,
            rotations,
            zeros: vec![0.0; nodes],
            ones: vec![1.0; nodes],
            iterations: 0,
        }
    }

    /// Linearises the static forces at the current state.
    pub(super) fn linearise_static(&mut self, parts: TangentParts) -> Tangent {
        let zeros = vec![0.0; self.plan.nodes()];
        let still = vec![zero(); self.state.u.len()];
        let net = match &self.newton {
            Some(newton) if !newton.rigid.is_empty() => self.forces_at(&still),
            _ => still.clone(),
        };
        let forces = Forces {
            net: &net,
            velocities: &still,
        };
        self.linearise_exactly(parts, (STATIC_STEP, zeros), forces)
    }

    /// Returns −Σ f·∂²x/∂θ² of each rigid body for the forces f on its nodes.
    fn rotation_tangents(&self, forces: &[V4<f64>]) -> Vec<DMat3> {
        let Some(newton) = self.newton.as_ref().filter(|n| !n.rigid.is_empty()) else {
            return Vec::new();
        };
        let rigid = &newton.rigid;
        let bodies = rigid.bodies.iter().zip(&rigid.now);
        let tangents = bodies.map(|(body, pose)| {
            let (pivot, _) = body.pivot(pose);
            let moment = body.nodes.clone().fold(DMat3::ZERO, |sum, i| {
                let arm = pose.rotation * (rigid.lever_arms[i - rigid.first] - pivot);
                sum + outer(to_dvec(forces[i]), arm)
            });
            // ∂²x/∂θ_j∂θ_k of x = exp([θ]×) a is ½ (e_j × (e_k × a) + e_k × (e_j × a)).
            let trace = moment.x_axis.x + moment.y_axis.y + moment.z_axis.z;
            let symmetric = (moment + moment.transpose()) * 0.5;
            DMat3::from_diagonal(DVec3::splat(trace)) - symmetric
        });
        tangents.collect()
    }

    /// Returns (D/h + K)ᵀ p for displacements of all slots, with or without the loads' part.
    pub(super) fn multiply_tangent(
        &self,
        tangent: &Tangent,
        p: &[V4<f64>],
        with_loads: bool,
    ) -> Vec<V4<f64>> {
        let nodes = self.plan.nodes();
        let mut y = vec![zero(); self.state.u.len()];
        let matrix = SystemOperator {
            plan: &self.plan,
            masses: &tangent.zeros,
            free: &tangent.ones,
            terms: &self.terms[..],
        };
        matrix.multiply(&p[..nodes], &mut y[..nodes]);
        for y in &mut y {
            *y = scale(1.0 / (tangent.step * tangent.step), *y);
        }
        for (nodes, blocks) in &tangent.pairs {
            for (a, i) in nodes.iter().enumerate() {
                for (b, j) in nodes.iter().enumerate() {
                    // Symmetric, apart from the error of the differences.
                    let product = blocks[b][a].transpose() * to_dvec(p[*j as usize]);
                    y[*i as usize] = add(y[*i as usize], to_v4(product));
                }
            }
        }
        for ([i, j], block) in &tangent.springs {
            let (i, j) = (*i as usize, *j as usize);
            let product = to_v4(*block * to_dvec(sub(p[i], p[j])));
            y[i] = add(y[i], product);
            y[j] = sub(y[j], product);
        }
        if with_loads && tangent.has_loads {
            let with = (&self.state.u[..], p);
            self.loads
                .subtract_transposed_tangent(&self.plan, with, &mut y);
        }
        y
    }

    /// Returns Aᵀ times the degrees of freedom `x`.
    fn multiply_freedoms(&self, tangent: &Tangent, x: &[f64]) -> Vec<f64> {
        let p = self.prolong_freedoms(x);
        let mut y = self.multiply_tangent(tangent, &p, true);
        let square = tangent.step * tangent.step;
        for ((y, p), m) in y.iter_mut().zip(&p).zip(&tangent.masses) {
            *y = add_scaled(*y, m / square, *p);
        }
        let mut r = self.restrict_forces(&y);
        let soft = 3 * self.soft_nodes();
        let bodies = tangent.rotations.iter().enumerate();
        let rigid = self.newton.as_ref().map(|n| &n.rigid);
        for (b, hessian) in bodies {
            let Some(rigid) = rigid else {
                break;
            };
            let (_, within) = rigid.bodies[b].pivot(&rigid.now[b]);
            let at = soft + 6 * b + 3;
            let turn = DVec3::new(x[at], x[at + 1], x[at + 2]);
            let moment = within * (*hessian * (within * turn));
            for (r, m) in r[at..].iter_mut().zip(moment.to_array()) {
                *r += m;
            }
        }
        r
    }

    /// Solves approximately for the degrees of freedom under the forces `r` on them, with the part
    /// of A that the terms linearise; `None` if it is not positive definite.
    fn precondition(&self, tangent: &mut Tangent, r: &[f64]) -> Option<Vec<f64>> {
        let f = self.spread_forces(r);
        tangent.solver.solver.residual.copy_from_slice(&f);
        let context = StepContext {
            plan: &self.plan,
            masses: &tangent.masses,
            free: &self.free_mask,
            rest: &self.rest_local,
            at: StateRef {
                u: &self.state.u,
                v: &self.state.v,
            },
            f: &self.state.f,
        };
        let (start, _, definite) = tangent.solver.build_block_jacobi(&context);
        if !definite {
            return None;
        }
        let matrix = SystemOperator {
            plan: &self.plan,
            masses: &tangent.masses,
            free: &self.free_mask,
            terms: &self.terms[..],
        };
        let tolerance = match tangent.is_exact {
            true => EXACT_TOLERANCE,
            false => CORRECTED_TOLERANCE,
        };
        let stop = CgTolerance {
            tolerance,
            floor: 0.0,
            max_iterations: MAX_ITERATIONS,
        };
        let found = tangent.solver.solve_from_zero(&matrix, start, stop);
        tangent.iterations += found.iterations;
        if found.indefinite {
            return None;
        }
        let solution = &tangent.solver.solver.solution;
        Some(self.read_freedoms(solution, tangent.step * tangent.step))
    }

    /// Solves Aᵀ x = b for the degrees of freedom. Errors name the state as `what`.
    ///
    /// # Errors
    /// [`Error::Input`] if A is not positive definite, or the solve does not converge.
    pub(super) fn solve_freedoms(
        &self,
        tangent: &mut Tangent,
        b: &[f64],
        what: &str,
    ) -> Result<Vec<f64>> {
        let tangent = std::cell::RefCell::new(tangent);
        let found = flexible_gmres(
            |x| self.multiply_freedoms(&tangent.borrow(), x),
            |r| self.precondition(&mut tangent.borrow_mut(), r),
            b,
            (TOLERANCE, MAX_SOLVES),
        );
        match found {
            Some(found) if found.residual <= ACCEPTED_RESIDUAL => Ok(found.solution),
            Some(found) => Err(Error::Input(format!(
                "the linear solve of a gradient stopped at a relative residual of {:.1e}: the {what} is almost unstable; support the body, or reduce its loads",
                found.residual
            ))),
            None => Err(Error::Input(format!(
                "the body has no gradient: its {what} is not stable, or it can move without resistance; support it, or reduce its loads"
            ))),
        }
    }

    /// Returns vectors in the network's order as those of the slots, divided by `unit`.
    pub(super) fn to_slots(&self, vectors: &[DVec3], unit: f64) -> Vec<V4<f64>> {
        let of = |v: &u32| vectors.get(*v as usize).copied().unwrap_or_default();
        self.node_order
            .iter()
            .map(|v| to_v4(of(v) / unit))
            .collect()
    }

    /// Returns vectors of the slots in the network's order, times `unit`.
    pub(super) fn to_network(&self, slots: &[V4<f64>], unit: f64) -> Vec<DVec3> {
        let places = self.engine_index.iter().take(self.node_count());
        places.map(|k| unit * to_dvec(slots[*k as usize])).collect()
    }
}
