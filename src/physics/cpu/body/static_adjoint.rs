//! The adjoint of the static equilibrium of a body: one solve with the transposed tangent of its
//! static forces.
//!
//! With the residual R(u) = −f(u), K = ∂R/∂u and a quantity Q, K z = ∂Q/∂u on the free degrees of
//! freedom; then dQ = z·df for any change of the forces at fixed u. A quantity that is itself a
//! force, d·f on some nodes, adds d to z at these nodes.
//!
//! K is exact: element Hessians without projection, the loads' own tangents, the exact Hessian of
//! self-contact and the rotation of the forces on rigid bodies. Conjugate gradients solve with the
//! part that terms linearise, which is symmetric; flexible GMRES corrects for the rest.

use super::CpuBody;
use super::force_assembly::ForceSources;
use crate::physics::CgSettings;
use crate::physics::cpu::contact::contact_derivatives::{PairTangent, WeightDerivatives};
use crate::physics::cpu::elements::muscle::MuscleTerm;
use crate::physics::cpu::implicit::contact_terms::{self_contact, tool_contact};
use crate::physics::cpu::implicit::linear_step::{LinearStepSolver, StepContext};
use crate::physics::cpu::linear::cg::{CgTolerance, SystemOperator};
use crate::physics::cpu::linear::flexible_gmres::flexible_gmres;
use crate::physics::cpu::rigid::pose::PROXY_NODES;
use crate::physics::cpu::runtime::static_adjoint::{
    AdjointSeed, AdjointSolution, StaticAdjoint, TangentParts, ToolSlopes,
};
use crate::physics::cpu::springs::term::Springs;
use crate::physics::cpu::term::{StateRef, Term, find_term};
use crate::physics::cpu::vectors::{V4, add, outer, scale, sub, to_dvec, to_v4, zero};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::any::Any;
use std::sync::Arc;

/// Length of the step of the linearisation: A = M + h D + h² K, in which damping is below rounding.
/// A power of 2, so that the division by h² is exact.
const STEP: f64 = (1u64 << 60) as f64;

/// Relative residual of the adjoint solve, and the largest that is accepted.
const TOLERANCE: f64 = 1e-12;
const ACCEPTED_RESIDUAL: f64 = 1e-8;

/// Relative residual of conjugate gradients, if the matrix is exact and if GMRES corrects it.
const EXACT_TOLERANCE: f64 = 1e-12;
const CORRECTED_TOLERANCE: f64 = 1e-4;

/// Largest number of conjugate gradient solves, and of the iterations of one.
const MAX_SOLVES: usize = 200;
const MAX_ITERATIONS: u32 = 100_000;

/// The tangent of a body at its state.
struct Tangent {
    solver: LinearStepSolver<f64>,
    /// Exact Hessians of self-contact less the linearised ones.
    pairs: Vec<PairTangent>,
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
    iterations: u32,
}

impl StaticAdjoint for CpuBody<f64> {
    fn adjoint(&mut self, seed: &AdjointSeed) -> Result<AdjointSolution> {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let mut tangent = self.linearise_static(seed.parts);
            self.solve_adjoint(&mut tangent, seed)
        })
    }
}

impl CpuBody<f64> {
    /// Linearises the static forces at the current state.
    fn linearise_static(&mut self, parts: TangentParts) -> Tangent {
        let nodes = self.plan.nodes();
        let zeros = vec![0.0; nodes];
        let still = vec![zero(); self.state.u.len()];
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
            masses: &zeros,
            free: &self.free_mask,
            rest: &self.rest_local,
            at: StateRef {
                u: &self.state.u,
                v: &still,
            },
            f: &self.state.f,
        };
        for term in &mut self.terms {
            term.set_psd_projection(!parts.unprojected);
        }
        solver.linearise(&context, &mut self.terms, context.at, STEP);
        solver.refresh_rigid_projection(&self.terms, STEP);
        solver.refresh_coarse_space(&context, &self.terms, context.at.u, STEP);
        let pairs = self_contact(&self.terms)
            .filter(|_| parts.pairs)
            .map_or(Vec::new(), |term| term.tangent_corrections(&self.state.u));
        let springs: Option<&Springs<f64>> = find_term(&self.terms).filter(|_| parts.unprojected);
        let springs = springs.map_or(Vec::new(), |s| s.tangent_corrections(&self.state.u));
        let rotations = match parts.rotations {
            true => self.rotation_tangents(&still),
            false => Vec::new(),
        };
        let has_loads = parts.loads && self.loads.has_tangent();
        Tangent {
            is_exact: pairs.is_empty() && springs.is_empty() && rotations.is_empty() && !has_loads,
            has_loads,
            solver,
            pairs,
            springs,
            rotations,
            ones: vec![1.0; nodes],
            zeros,
            iterations: 0,
        }
    }

    /// Returns −Σ f·∂²x/∂θ² of each rigid body, with f the static forces on its nodes.
    fn rotation_tangents(&self, still: &[V4<f64>]) -> Vec<DMat3> {
        let Some(newton) = self.newton.as_ref().filter(|n| !n.rigid.is_empty()) else {
            return Vec::new();
        };
        let mut forces = vec![zero(); self.state.u.len()];
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let at = StateRef {
            u: &self.state.u,
            v: still,
        };
        sources.forces(at, &mut forces);
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

    /// Returns Kᵀ p for displacements of all slots, with or without the loads' part.
    fn multiply_tangent(&self, tangent: &Tangent, p: &[V4<f64>], with_loads: bool) -> Vec<V4<f64>> {
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
            *y = scale(1.0 / (STEP * STEP), *y);
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

    /// Returns the transposed tangent times the degrees of freedom `x`.
    fn multiply_freedoms(&self, tangent: &Tangent, x: &[f64]) -> Vec<f64> {
        let y = self.multiply_tangent(tangent, &self.prolong_freedoms(x), true);
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
    /// of K that the terms linearise; `None` if it is not positive definite.
    fn precondition(&self, tangent: &mut Tangent, r: &[f64]) -> Option<Vec<f64>> {
        let f = self.spread_forces(r);
        tangent.solver.solver.residual.copy_from_slice(&f);
        let context = StepContext {
            plan: &self.plan,
            masses: &tangent.zeros,
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
            masses: &tangent.zeros,
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
        Some(self.read_freedoms(solution, STEP * STEP))
    }

    /// Returns vectors in the network's order as those of the slots, divided by `unit`.
    fn to_slots(&self, vectors: &[DVec3], unit: f64) -> Vec<V4<f64>> {
        let of = |v: &u32| vectors.get(*v as usize).copied().unwrap_or_default();
        self.node_order
            .iter()
            .map(|v| to_v4(of(v) / unit))
            .collect()
    }

    /// Returns vectors of the slots in the network's order, times `unit`.
    fn to_network(&self, slots: &[V4<f64>], unit: f64) -> Vec<DVec3> {
        let places = self.engine_index.iter().take(self.node_count());
        places.map(|k| unit * to_dvec(slots[*k as usize])).collect()
    }

    /// Solves for the derivatives of the quantity, here by forces and displacements in local units.
    fn solve_adjoint(&self, tangent: &mut Tangent, seed: &AdjointSeed) -> Result<AdjointSolution> {
        let slots = self.state.u.len();
        // By displacements in local units.
        let mut rhs = self.to_slots(&seed.gradient, 1.0 / self.units.length);
        let mut both = vec![zero(); slots];
        if let Some((nodes, direction)) = &seed.reaction {
            for v in nodes {
                both[self.engine_index[*v as usize] as usize] = to_v4(*direction);
            }
        }
        // A quantity in N is 1/unit of force in local units.
        let force = self.units.force();
        let mut terms_only = vec![zero(); slots];
        if let (Some((b, direction)), Some(newton)) = (&seed.region, &self.newton) {
            let body = &newton.rigid.bodies[*b];
            terms_only[body.nodes.start..body.nodes.end - PROXY_NODES].fill(to_v4(*direction));
        }
        for (p, with_loads) in [(&both, true), (&terms_only, false)] {
            if p.iter().any(|p| *p != [0.0; 4]) {
                let y = self.multiply_tangent(tangent, p, with_loads);
                for (rhs, y) in rhs.iter_mut().zip(y) {
                    *rhs = sub(*rhs, scale(force, y));
                }
            }
        }
        let contact = tool_contact(&self.terms);
        if let (Some(tool), Some(contact)) = (seed.tool, contact) {
            for (i, g) in contact.tool_force_gradient(&self.state.u, tool) {
                rhs[i] = add(rhs[i], to_v4(force * g));
            }
        }
        let b = self.restrict_forces(&rhs);
        let x = self.solve_freedoms(tangent, &b)?;
        let z = self.prolong_freedoms(&x);
        let supports: Vec<V4<f64>> = {
            let y = self.multiply_tangent(tangent, &z, true);
            let left = rhs.iter().zip(y).zip(0..);
            let held = |i: usize| i < self.soft_nodes() && self.free_mask[i] == 0.0;
            left.map(|((g, y), i)| if held(i) { sub(*g, y) } else { zero() })
                .collect()
        };
        // λ times a force in local units is a quantity: z from the solve, d at reactions.
        let sum = |a: &[V4<f64>], b: &[V4<f64>]| -> Vec<V4<f64>> {
            let all = a.iter().zip(b);
            all.map(|(a, b)| add(*a, scale(force, *b))).collect()
        };
        let loads = sum(&z, &both);
        let terms = sum(&loads, &terms_only);
        Ok(self.collect_derivatives(tangent, [terms, loads, supports], seed))
    }

    /// Solves for the adjoint degrees of freedom.
    fn solve_freedoms(&self, tangent: &mut Tangent, b: &[f64]) -> Result<Vec<f64>> {
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
                "the linear solve of a gradient stopped at a relative residual of {:.1e}: the equilibrium is almost unstable; support the body, or reduce its loads",
                found.residual
            ))),
            None => Err(Error::Input(
                "the body has no gradient: its equilibrium is not stable, or it can move without resistance; support it, or reduce its loads".into(),
            )),
        }
    }

    /// Returns the solution in SI units, with the derivatives by what the engine alone has.
    fn collect_derivatives(
        &self,
        tangent: &Tangent,
        [terms, loads, supports]: [Vec<V4<f64>>; 3],
        seed: &AdjointSeed,
    ) -> AdjointSolution {
        let units = self.units;
        let u = &self.state.u;
        let mut weights = WeightDerivatives::new(self.state.u.len());
        let mut tools = Vec::new();
        let mut faces = Vec::new();
        if let Some(contact) = tool_contact(&self.terms) {
            let force = seed.tool.map(|(tool, d)| (tool, units.force() * d));
            let slopes = contact.force_derivatives(u, &terms, force, &mut weights);
            tools.extend(slopes.iter().map(|d| ToolSlopes {
                translation: d.translation / units.length,
                rotation: d.rotation,
                gap: d.gap / units.length,
            }));
        }
        if let Some(term) = self_contact(&self.terms) {
            term.add_weight_derivatives(u, &terms, &mut weights);
            faces = weights.of_faces(term.surface.hull());
        } else if let Some(contact) = tool_contact(&self.terms) {
            faces = weights.of_faces(&contact.hull);
        }
        faces.iter_mut().for_each(|f| *f /= units.force());
        AdjointSolution {
            amplitudes: (0..seed.amplitudes)
                .map(|level| self.amplitude_derivative(level, seed.amplitudes, [&terms, &loads]))
                .collect(),
            terms: self.to_network(&terms, 1.0 / units.force()),
            loads: self.to_network(&loads, 1.0 / units.force()),
            supports: self.to_network(&supports, 1.0 / units.length),
            tools,
            faces,
            iterations: tangent.iterations,
        }
    }

    /// Returns the derivative by the amplitude of index `level` of `count`: λ times the forces of
    /// unit pressure and of full activation.
    fn amplitude_derivative(
        &self,
        level: usize,
        count: usize,
        [terms, loads]: [&[V4<f64>]; 2],
    ) -> f64 {
        let mut levels = vec![0.0; count];
        levels[level] = 1.0;
        let u = &self.state.u;
        let mut pressures = vec![zero(); u.len()];
        self.loads
            .add_pressures_at(&self.plan, &levels, u, &mut pressures);
        let mut muscles = vec![zero(); u.len()];
        for term in &self.terms {
            let term: &dyn Any = term.as_ref();
            let Some(muscle) = term.downcast_ref::<MuscleTerm<f64>>() else {
                continue;
            };
            let mut full = muscle.clone();
            full.set_amplitudes(&levels);
            for chunk in 0..self.plan.chunks() {
                full.elastic_forces(chunk, u, &mut muscles[self.plan.range(chunk)]);
            }
        }
        let work = |f: &[V4<f64>], lambda: &[V4<f64>]| -> f64 {
            let all = f.iter().zip(lambda);
            all.map(|(f, l)| to_dvec(*f).dot(to_dvec(*l))).sum()
        };
        work(&pressures, loads) + work(&muscles, terms)
    }
}
