//! The adjoint of implicit steps: each step's reverse is one solve with its transposed matrix.
//!
//! A step solves r(δ) = M (w − ṽ)/γ + α M w + D(u*) w − f(u + δ) − g(u) = 0 with w = (δ − b)/γ,
//! where f are the forces of terms, g the loads at its start and u* = u + τ v
//! ([`schemes`](crate::physics::cpu::implicit::schemes)). With the derivative q by δ, A z = q and A
//! = (1/γ² + α/γ) M + D/γ + K,
//!
//! - u gets −K z + (∂g/∂u)ᵀ z − ∂(z·D(u*) w)/∂u*, and v gets τ times the last of these;
//! - ṽ gets M z/γ, and b gets (1/γ² + α/γ) M z + D z/γ;
//! - any change of the forces at fixed u and δ gets z.

use super::CpuBody;
use crate::physics::cpu::elements::damping_derivatives::damping_derivatives;
use crate::physics::cpu::implicit::contact_terms::{
    self_contact, self_contact_mut, tool_contact, tool_contact_mut,
};
use crate::physics::cpu::implicit::schemes::{ImplicitScheme, StepCoefficients};
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::motion_adjoint::{
    MotionAdjoint, MotionState, StateAdjoint, StepAdjoint, StepParts,
};
use crate::physics::cpu::runtime::static_adjoint::{AdjointSeed, AdjointSolution, TangentParts};
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, add, add_scaled, scale, sub, to_dvec, zero};
use crate::physics::{DiscreteModel, NewtonSettings, StepRecord};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Largest residual of a step, and the largest number of Newton iterations.
const STEP_TOLERANCE: f64 = 1e-10;
const STEP_ITERATIONS: u32 = 60;

/// Relative residual of the linear solves of a step.
const STEP_LINEAR_TOLERANCE: f64 = 1e-3;

/// A vector of every slot.
type Slots = Vec<V4<f64>>;

/// What a step computes with, in local units.
struct Step {
    coefficients: StepCoefficients,
    /// Where forces are evaluated.
    u: Slots,
    /// w, and (w − ṽ)/γ + α w.
    w: Slots,
    inertia: Slots,
    /// u*.
    lagged: Slots,
    /// α.
    mass_damping: f64,
}

impl MotionAdjoint for CpuBody<f64> {
    fn begin_motion(&mut self) -> Result<(MotionState, NewtonSettings)> {
        self.check_motion()?;
        let before = self.state.u.clone();
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| self.prepare_forces())
            .map_err(|failure| Error::Input(failure.to_string()))?;
        if self.state.u != before {
            return Err(refused(
                "of a body whose nodes begin inside a tool; begin without contact",
            ));
        }
        // Contact at the start: an intersection would be separated in the first steps.
        self.show_displacements(&before)?;
        let mut own = NewtonSettings::default();
        if let Some(newton) = &mut self.newton {
            own = newton.settings;
            newton.settings = NewtonSettings {
                iterations: own.iterations.max(STEP_ITERATIONS),
                tolerance: match own.tolerance > 0.0 {
                    true => own.tolerance.min(STEP_TOLERANCE),
                    false => STEP_TOLERANCE,
                },
                linear_tolerance: own.linear_tolerance.min(STEP_LINEAR_TOLERANCE),
            };
        }
        Ok((self.motion_state(), own))
    }

    fn end_motion(&mut self, own: NewtonSettings) {
        if let Some(newton) = &mut self.newton {
            newton.settings = own;
        }
    }

    fn motion_step(&mut self, dt: f64) -> std::result::Result<StepRecord, StepFailure> {
        self.run(1, dt)
    }

    fn motion_state(&self) -> MotionState {
        let is_bdf2 = self.scheme() == ImplicitScheme::Bdf2;
        let solver = self.implicit.as_ref().map(|implicit| &implicit.solver);
        let history = solver.filter(|s| is_bdf2 && s.count == 2 && self.previous_dt > 0.0);
        MotionState {
            u: self.state.u.clone(),
            v: self.state.v.clone(),
            change: history.map_or(Vec::new(), |s| s.previous_solutions[0].clone()),
            last: history.map_or(0.0, |_| self.previous_dt),
        }
    }

    fn motion_state_bytes(&self) -> usize {
        let vectors = match self.scheme() {
            ImplicitScheme::Bdf2 => 3,
            _ => 2,
        };
        vectors * self.state.u.len() * size_of::<V4<f64>>()
    }

    fn show_state(&mut self, state: &MotionState) -> Result<()> {
        self.state.v.copy_from_slice(&state.v);
        self.show_displacements(&state.u)
    }

    fn add_quantity(
        &mut self,
        seed: &AdjointSeed,
        weight: f64,
        adjoint: &mut StateAdjoint,
    ) -> AdjointSolution {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let tangent = seed
                .reaction
                .is_some()
                .then(|| self.linearise_static(seed.parts));
            let vectors = self.seed_vectors(tangent.as_ref(), seed);
            adjoint.u.resize(self.state.u.len(), zero());
            for (to, g) in adjoint.u.iter_mut().zip(&vectors.by_position) {
                *to = add_scaled(*to, weight, *g);
            }
            let none = vec![zero(); self.state.u.len()];
            self.derivatives_of_seed(&vectors, &none, seed)
        })
    }

    fn reverse_step(
        &mut self,
        [from, to]: [&MotionState; 2],
        dt: f64,
        (network, seed, parts): (&DiscreteModel, &AdjointSeed, StepParts),
        adjoint: &mut StateAdjoint,
    ) -> Result<StepAdjoint> {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let step = self.step_between([from, to], dt / self.units.time);
            self.show_displacements(&step.u)?;
            for term in &mut self.terms {
                term.freeze_damping(&plan, &step.lagged);
            }
            let mut iterations = 0;
            let solved = self.solve_step(&step, parts, (adjoint, &mut iterations))?;
            let (z, at) = (&solved[0], (&step, &from.u[..]));
            let mut found = self.step_derivatives(at, z, seed);
            found.solution.iterations = iterations;
            self.pull_back(at, &solved, parts, adjoint);
            if parts.damping && self.is_damped() {
                found.solution.lame = self.pull_back_damping(&step, network, z, adjoint);
            }
            Ok(found)
        })
    }

    fn by_state(&self, adjoint: &StateAdjoint) -> [Vec<DVec3>; 2] {
        let units = self.units;
        [
            self.to_network(&adjoint.u, 1.0 / units.length),
            self.to_network(&adjoint.v, 1.0 / units.velocity()),
        ]
    }
}

/// Returns the error for a body whose steps have no adjoint.
fn refused(what: &str) -> Error {
    Error::Input(format!("there is no gradient of a motion {what}"))
}

impl CpuBody<f64> {
    fn scheme(&self) -> ImplicitScheme {
        self.newton
            .as_ref()
            .map_or_else(Default::default, |n| n.rule)
    }

    fn is_damped(&self) -> bool {
        self.terms.iter().any(|term| term.damped())
    }

    /// Checks that the steps of the body have an adjoint.
    fn check_motion(&self) -> Result<()> {
        let Some(newton) = &self.newton else {
            return Err(refused(
                "of springs, whose steps are linearised; use --material neo-hookean (or corotated)",
            ));
        };
        if !newton.rigid.is_empty() {
            return Err(refused(
                "with rigid regions; make them stiff instead, or take the gradient at rest",
            ));
        }
        let rubs = tool_contact(&self.terms)
            .is_some_and(|c| c.tools.iter().any(|tool| tool.friction > 0.0))
            || self_contact(&self.terms).is_some_and(|own| own.friction > 0.0);
        if rubs {
            return Err(refused(
                "with friction, whose normal forces a step takes from the last iterate; set friction to 0",
            ));
        }
        let moves = tool_contact(&self.terms)
            .is_some_and(|c| c.tools.iter().any(|tool| tool.from != tool.to));
        if self.has_prescribed_motion() || !self.moving_constraints.is_empty() || moves {
            return Err(refused(
                "with supports or tools that are moving; let them arrive first",
            ));
        }
        Ok(())
    }

    /// Moves all nodes to the displacements `u`, and selects the contact there.
    fn show_displacements(&mut self, u: &[V4<f64>]) -> Result<()> {
        self.state.u.copy_from_slice(u);
        let nodes = (&self.free_mask[..], &*self.plan);
        if let Some(contact) = tool_contact_mut(&mut self.terms) {
            contact.begin(u, nodes, (0.0, 0.0));
        }
        if let (Some(newton), Some(term)) = (&self.newton, self_contact_mut(&mut self.terms)) {
            let still = |_: usize| DVec3::ZERO;
            term.begin((u, nodes.0, nodes.1), &newton.rigid, &still);
            if term.is_separating() {
                return Err(refused(
                    "of a body that intersects itself; begin without intersections",
                ));
            }
        }
        Ok(())
    }

    /// Returns what the step of `h` local units between two states computed with.
    fn step_between(&self, [from, to]: [&MotionState; 2], h: f64) -> Step {
        let scheme = self.scheme();
        let coefficients = scheme.coefficients(h, from.last);
        let mass_damping = self.newton.as_ref().map_or(0.0, |n| n.mass_damping);
        let part = 1.0 / coefficients.end_scale;
        let between = |a: &[V4<f64>], b: &[V4<f64>]| -> Slots {
            let both = a.iter().zip(b);
            both.map(|(a, b)| add_scaled(*a, part, sub(*b, *a)))
                .collect()
        };
        let (u, w) = (between(&from.u, &to.u), between(&from.v, &to.v));
        let inertia = (0..w.len()).map(|i| {
            let mut change = sub(w[i], from.v[i]);
            if coefficients.history > 0.0 {
                let before = from.change.get(i).copied().unwrap_or_default();
                change = add_scaled(change, -coefficients.history, before);
            }
            add_scaled(scale(1.0 / coefficients.gamma, change), mass_damping, w[i])
        });
        let ahead = lag(scheme, &coefficients);
        let lagged = from.u.iter().zip(&from.v);
        Step {
            inertia: inertia.collect(),
            lagged: lagged.map(|(u, v)| add_scaled(*u, ahead, *v)).collect(),
            coefficients,
            u,
            w,
            mass_damping,
        }
    }

    /// Solves A z = q for the derivative q by δ, of the derivatives `adjoint` by the end of the
    /// step. Leaves in `adjoint` those by its start that do not go through δ. Returns z, K z and D
    /// z.
    fn solve_step(
        &mut self,
        step: &Step,
        parts: StepParts,
        (adjoint, iterations): (&mut StateAdjoint, &mut u32),
    ) -> Result<[Slots; 3]> {
        let slots = self.state.u.len();
        let take = |of: &mut Slots| {
            let mut taken = std::mem::take(of);
            taken.resize(slots, zero());
            taken
        };
        let [mut by_u, mut by_v] = [take(&mut adjoint.u), take(&mut adjoint.v)];
        let [by_change, by_moved] = [take(&mut adjoint.change), take(&mut adjoint.moved)];
        let (gamma, stride) = (step.coefficients.gamma, step.coefficients.end_scale);
        let mut right = vec![zero(); slots];
        *adjoint = StateAdjoint {
            u: right.clone(),
            v: right.clone(),
            change: right.clone(),
            moved: right.clone(),
        };
        for i in 0..slots {
            let free = self.free_mask[i];
            by_u[i] = add(by_u[i], by_moved[i]);
            by_v[i] = add(by_v[i], scale(free, by_change[i]));
            // The step ends at u + s δ with v + s (w − v), s = 1 or 2.
            right[i] = scale(free * stride, add_scaled(by_u[i], 1.0 / gamma, by_v[i]));
            adjoint.u[i] = sub(by_u[i], by_moved[i]);
            let direct = scale(1.0 - free * stride, by_v[i]);
            adjoint.v[i] = add_scaled(direct, -free, by_change[i]);
            adjoint.moved[i] = scale(-free * stride / gamma, by_v[i]);
        }
        let heavier = 1.0 + step.mass_damping * gamma;
        let nodes = self.plan.nodes();
        let masses = self.masses[..nodes].iter().map(|m| heavier * m).collect();
        let with = TangentParts {
            unprojected: parts.unprojected,
            pairs: parts.pairs,
            loads: false,
            rotations: true,
        };
        let mut tangent = self.linearise_exactly(with, (gamma, masses));
        let b = self.restrict_forces(&right);
        let x = self.solve_freedoms(&mut tangent, &b, "step")?;
        *iterations = tangent.iterations;
        let z = self.prolong_freedoms(&x);
        let damped = self.damping_product(&step.lagged, &z);
        let mut stiff = self.multiply_tangent(&tangent, &z, false);
        for i in 0..slots {
            // Where A z = q holds, K z follows from the masses, without the rounding of stiff
            // contact.
            stiff[i] = match self.free_mask[i] > 0.0 {
                true => {
                    let m = heavier * self.masses[i] / (gamma * gamma);
                    let rest = add_scaled(scale(m, z[i]), 1.0 / gamma, damped[i]);
                    sub(right[i], rest)
                }
                false => add_scaled(stiff[i], -1.0 / gamma, damped[i]),
            };
        }
        Ok([z, stiff, damped])
    }

    /// Returns D(u*) p.
    fn damping_product(&self, lagged: &[V4<f64>], p: &[V4<f64>]) -> Slots {
        let mut y = vec![zero(); p.len()];
        let at = StateRef { u: lagged, v: p };
        for chunk in 0..self.plan.chunks() {
            for term in self.terms.iter().filter(|term| term.damped()) {
                term.damping_forces(chunk, at, &mut y[self.plan.range(chunk)]);
            }
        }
        y.iter().map(|y| scale(-1.0, *y)).collect()
    }

    /// Adds to the derivatives by the start of a step those through z.
    fn pull_back(
        &self,
        (step, start): (&Step, &[V4<f64>]),
        [z, stiff, damped]: &[Slots; 3],
        parts: StepParts,
        adjoint: &mut StateAdjoint,
    ) {
        let StepCoefficients { gamma, history, .. } = step.coefficients;
        let mut loads = vec![zero(); z.len()];
        if parts.loads && self.loads.has_tangent() {
            self.loads
                .subtract_transposed_tangent(&self.plan, (start, z), &mut loads);
        }
        let heavier = (1.0 + step.mass_damping * gamma) / (gamma * gamma);
        for i in 0..z.len() {
            let (m, free) = (self.masses[i], self.free_mask[i]);
            adjoint.u[i] = sub(adjoint.u[i], add(stiff[i], loads[i]));
            let by_velocity = scale(free * m / gamma, z[i]);
            if parts.velocities {
                adjoint.v[i] = add(adjoint.v[i], by_velocity);
            }
            let by_offset = add_scaled(scale(heavier * m, z[i]), 1.0 / gamma, damped[i]);
            let by_offset = add_scaled(adjoint.moved[i], free, by_offset);
            let kept = if parts.history { history } else { 0.0 };
            adjoint.change[i] = scale(kept, by_velocity);
            adjoint.moved[i] = scale(kept, by_offset);
        }
    }

    /// Adds the derivatives of −z·D(u*) w by u* to those by the start of a step; returns those by
    /// the Lamé parameters of every element.
    fn pull_back_damping(
        &self,
        step: &Step,
        network: &DiscreteModel,
        z: &[V4<f64>],
        adjoint: &mut StateAdjoint,
    ) -> Vec<[f64; 2]> {
        let layout = (&self.engine_index[..], &self.units);
        let vectors = [&step.lagged[..], z, &step.w];
        let found = damping_derivatives(network, layout, vectors);
        let ahead = lag(self.scheme(), &step.coefficients);
        for (i, g) in found.by_position.iter().enumerate() {
            adjoint.u[i] = sub(adjoint.u[i], *g);
            adjoint.v[i] = add_scaled(adjoint.v[i], -ahead * self.free_mask[i], *g);
        }
        let negative = found.by_lame.into_iter();
        negative.map(|lame| lame.map(|by| -by)).collect()
    }

    /// Returns the derivatives by what enters a step besides its start, and its residual.
    fn step_derivatives(
        &self,
        (step, start): (&Step, &[V4<f64>]),
        z: &[V4<f64>],
        seed: &AdjointSeed,
    ) -> StepAdjoint {
        let acceleration = self.units.acceleration();
        StepAdjoint {
            solution: self.collect_derivatives([z, z], start, seed),
            positions: self.positions(),
            inertia: self.to_network(&step.inertia, acceleration),
            residual: self.step_residual(step, start),
        }
    }

    /// Returns the largest net force of a step over the largest force.
    fn step_residual(&self, step: &Step, start: &[V4<f64>]) -> f64 {
        let (mut residual, mut largest): (f64, f64) = (0.0, 0.0);
        let damped = self.damping_product(&step.lagged, &step.w);
        for chunk in 0..self.plan.chunks() {
            let own = self.plan.range(chunk);
            let mut loads = vec![zero(); own.len()];
            self.loads
                .write_forces(&self.plan, chunk, &self.masses, start, &mut loads);
            let mut inner = vec![zero(); own.len()];
            for term in &self.terms {
                term.elastic_forces(chunk, &step.u, &mut inner);
            }
            for (n, i) in own.enumerate().filter(|(_, i)| self.free_mask[*i] > 0.0) {
                let inertia = to_dvec(step.inertia[i]) * self.masses[i];
                let forces = [
                    -inertia,
                    to_dvec(loads[n]),
                    to_dvec(inner[n]),
                    -to_dvec(damped[i]),
                ];
                residual = residual.max(forces.iter().sum::<DVec3>().length());
                let lengths = forces.iter().map(|f| f.length());
                largest = lengths.fold(largest, f64::max);
            }
        }
        match largest > 0.0 {
            true => residual / largest,
            false => 0.0,
        }
    }
}

/// Returns τ, the time by which damping is evaluated ahead.
fn lag(scheme: ImplicitScheme, coefficients: &StepCoefficients) -> f64 {
    match scheme {
        ImplicitScheme::Euler => 0.0,
        _ => coefficients.evaluation_time,
    }
}
