//! The reverse of one implicit step: a solve with its transposed matrix.
//!
//! A step solves r(δ) = M (w − ṽ)/γ + α M w + D(u*) w − f(u + δ) − g(u) = 0 with w = (δ − b)/γ,
//! where f are the forces of terms, g the loads at its start and u* = u + τ v
//! ([`schemes`](crate::physics::cpu::implicit::schemes)). With the derivative q by δ, A z = q and A
//! = (1/γ² + α/γ) M + D/γ + K,
//!
//! - u gets −K z + (∂g/∂u)ᵀ z − ∂(z·D(u*) w)/∂u*, and v gets τ times the last of these;
//! - ṽ gets M z/γ, and b gets (1/γ² + α/γ) M z + D z/γ;
//! - any change of the forces at fixed u and δ gets z.
//!
//! Friction has part in D, by its tangent at w, and in K, by the normal forces and normals that it
//! depends on, which have converged in the step: A is then not symmetric, and A stands for Aᵀ.
//!
//! The nodes of a rigid body end where its pose places them, wherever they began: their u gets what
//! b gets. In the midpoint rule a body has an inertial target and an end of its own
//! ([`midpoint_adjoint`](crate::physics::cpu::rigid::midpoint_adjoint)).

use super::CpuBody;
use super::rigid_adjoint::RigidEnds;
use super::tangent::{Forces, Tangent};
use crate::Result;
use crate::physics::DiscreteModel;
use crate::physics::cpu::elements::damping_derivatives::damping_derivatives;
use crate::physics::cpu::implicit::schemes::{ImplicitScheme, StepCoefficients};
use crate::physics::cpu::rigid::midpoint::MidpointStart;
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::runtime::motion_adjoint::{
    MotionState, StateAdjoint, StepAdjoint, StepParts,
};
use crate::physics::cpu::runtime::static_adjoint::{AdjointSeed, TangentParts};
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, add, add_scaled, scale, sub, to_dvec, zero};
use glam::DVec3;

/// A vector of every slot.
pub(super) type Slots = Vec<V4<f64>>;

/// What a step computes with, in local units.
pub(super) struct Step {
    pub coefficients: StepCoefficients,
    /// Where forces are evaluated.
    pub u: Slots,
    /// w, and (w − ṽ)/γ + α w.
    pub w: Slots,
    pub(super) inertia: Slots,
    /// u*.
    pub lagged: Slots,
    /// α.
    pub(super) mass_damping: f64,
    /// Poses of the rigid bodies where forces are evaluated.
    pub poses: Vec<Pose>,
    /// Motions of the rigid bodies at the start.
    pub(super) starts: Vec<MidpointStart>,
}

/// The net force on every slot in a step, 0 on soft nodes, and the largest of all forces.
pub(super) struct NetForces {
    pub net: Slots,
    pub largest: f64,
}

impl CpuBody<f64> {
    /// Returns what the step of `h` local units between two states computed with. Leaves the rigid
    /// bodies as they were at its start.
    pub(super) fn step_between(&mut self, [from, to]: [&MotionState; 2], h: f64) -> Step {
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
        let mut step = Step {
            inertia: inertia.collect(),
            lagged: lagged.map(|(u, v)| add_scaled(*u, ahead, *v)).collect(),
            coefficients,
            u,
            w,
            mass_damping,
            poses: to.poses.clone(),
            starts: Vec::new(),
        };
        if let Some(newton) = &mut self.newton {
            newton.rigid.set_motion(&from.poses, &from.torques);
            if scheme == ImplicitScheme::Midpoint {
                step.place_midpoint(&newton.rigid, [from, to]);
            }
        }
        step
    }

    /// Solves A z = q for the derivative q by δ, of the derivatives `adjoint` by the end of the
    /// step whose `tangent` is given. Leaves in `adjoint` those by its start that do not go through δ.
    /// Returns z, K z and D z, and what rigid bodies have of the end by their motions at the start.
    pub(super) fn solve_step(
        &self,
        (step, to): (&Step, &MotionState),
        tangent: &mut Tangent,
        adjoint: &mut StateAdjoint,
    ) -> Result<([Slots; 3], RigidEnds)> {
        let slots = self.state.u.len();
        let take = |of: &mut Slots| {
            let mut taken = std::mem::take(of);
            taken.resize(slots, zero());
            taken
        };
        let [mut by_u, mut by_v] = [take(&mut adjoint.u), take(&mut adjoint.v)];
        let [by_change, by_moved] = [take(&mut adjoint.change), take(&mut adjoint.moved)];
        let by_torques = std::mem::take(&mut adjoint.torques);
        let (gamma, stride) = (step.coefficients.gamma, step.coefficients.end_scale);
        let mut right = vec![zero(); slots];
        *adjoint = StateAdjoint {
            u: right.clone(),
            v: right.clone(),
            change: right.clone(),
            moved: right.clone(),
            torques: Vec::new(),
        };
        self.gather_interior_velocities(&mut by_v);
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
        let rigid_ends = self.reverse_rigid_ends(
            (step, to),
            [&by_u, &by_v],
            &by_torques,
            (&mut right, adjoint),
        );
        let heavier = 1.0 + step.mass_damping * gamma;
        let mut b = self.restrict_forces(&right);
        if let Some(newton) = &self.newton {
            rigid_ends.add_to_freedoms(&newton.rigid, 3 * self.soft_nodes(), &mut b);
        }
        let x = self.solve_freedoms(tangent, &b, "step")?;
        let z = self.prolong_freedoms(&x);
        let mut damped = self.damping_product(&step.lagged, &z);
        for friction in &tangent.friction {
            friction.add_velocity_product(&z, &mut damped);
        }
        let mut stiff = self.multiply_tangent(tangent, &z, false);
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
        Ok(([z, stiff, damped], rigid_ends))
    }

    /// Linearises the forces of a step where it evaluates them.
    pub(super) fn linearise_step(
        &mut self,
        step: &Step,
        parts: StepParts,
        forces: &NetForces,
    ) -> Tangent {
        let gamma = step.coefficients.gamma;
        let heavier = 1.0 + step.mass_damping * gamma;
        let nodes = self.plan.nodes();
        let masses = self.masses[..nodes].iter().map(|m| heavier * m).collect();
        let with = TangentParts {
            unprojected: parts.unprojected,
            pairs: parts.pairs,
            loads: false,
            rotations: true,
            friction: parts.friction,
        };
        let acting = Forces {
            net: &forces.net,
            velocities: &step.w,
        };
        self.linearise_exactly(with, (gamma, masses), acting)
    }

    /// Returns D(u*) p, without friction.
    fn damping_product(&self, lagged: &[V4<f64>], p: &[V4<f64>]) -> Slots {
        let mut y = vec![zero(); p.len()];
        let at = StateRef { u: lagged, v: p };
        for chunk in 0..self.plan.chunks() {
            for term in self.terms.iter().filter(|t| t.damped() && !t.is_friction()) {
                term.damping_forces(chunk, at, &mut y[self.plan.range(chunk)]);
            }
        }
        y.iter().map(|y| scale(-1.0, *y)).collect()
    }

    /// Adds to the derivatives by the start of a step those through z.
    pub(super) fn pull_back(
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
        let first = match self.scheme() {
            ImplicitScheme::Midpoint => self.soft_nodes(),
            _ => z.len(),
        };
        for i in 0..z.len() {
            let (m, free) = (self.masses[i], self.free_mask[i]);
            adjoint.u[i] = sub(adjoint.u[i], add(stiff[i], loads[i]));
            // Bodies in the midpoint rule have an inertial target instead.
            let own = if i >= first { 0.0 } else { free };
            let by_velocity = scale(own * m / gamma, z[i]);
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

    /// Adds the derivatives of −z·D(u*) w by u*, for each z, to those by the start of a step; returns those by
    /// the Lamé parameters of every element.
    pub(super) fn pull_back_damping(
        &self,
        step: &Step,
        network: &DiscreteModel,
        solved: &[&[V4<f64>]],
        adjoints: &mut [&mut StateAdjoint],
    ) -> Vec<Vec<[f64; 2]>> {
        let layout = (&self.engine_index[..], &self.units);
        let found = damping_derivatives(network, layout, [&step.lagged, &step.w], solved);
        let ahead = lag(self.scheme(), &step.coefficients);
        let mut by_lame = Vec::new();
        for (adjoint, found) in adjoints.iter_mut().zip(found) {
            for (i, g) in found.by_position.iter().enumerate() {
                adjoint.u[i] = sub(adjoint.u[i], *g);
                adjoint.v[i] = add_scaled(adjoint.v[i], -ahead, *g);
            }
            let negative = found.by_lame.into_iter();
            by_lame.push(negative.map(|lame| lame.map(|by| -by)).collect());
        }
        by_lame
    }

    /// Returns −z·D w/β and −z·M w: the derivatives by β, the time of stiffness-proportional damping, and by
    /// α, the rate of mass-proportional damping, 1/s and s.
    pub(super) fn damping_slopes(
        &self,
        step: &Step,
        network: &DiscreteModel,
        z: &[V4<f64>],
    ) -> [f64; 2] {
        let work = |f: &[V4<f64>]| -> f64 {
            let all = f.iter().zip(z);
            all.map(|(f, z)| to_dvec(*f).dot(to_dvec(*z))).sum()
        };
        let momenta = step.w.iter().zip(&self.masses).zip(&self.free_mask);
        let momenta: Slots = momenta.map(|((w, m), free)| scale(m * free, *w)).collect();
        let by_time = match network.damping_time > 0.0 {
            true => work(&self.damping_product(&step.lagged, &step.w)) / network.damping_time,
            false => 0.0,
        };
        [-by_time, -work(&momenta) * self.units.time]
    }

    /// Returns the derivatives by what enters a step besides its start, and its residual.
    pub(super) fn step_derivatives(
        &self,
        (step, start): (&Step, &[V4<f64>]),
        (z, forces): (&[V4<f64>], &NetForces),
        seed: &AdjointSeed,
    ) -> StepAdjoint {
        let acceleration = self.units.acceleration();
        StepAdjoint {
            solution: self.collect_derivatives([z, z], (start, Some(&step.w)), seed),
            positions: self.positions(),
            inertia: self.to_network(&step.inertia, acceleration),
            residual: self.relative_residual(forces),
        }
    }

    /// Returns the net forces of a step, inertia included.
    pub(super) fn net_forces(&self, step: &Step, start: &[V4<f64>]) -> NetForces {
        let mut forces = NetForces {
            net: vec![zero(); step.u.len()],
            largest: 0.0,
        };
        for chunk in 0..self.plan.chunks() {
            let own = self.plan.range(chunk);
            let mut loads = vec![zero(); own.len()];
            self.loads
                .write_forces(&self.plan, chunk, &self.masses, start, &mut loads);
            let mut inner = vec![zero(); own.len()];
            let mut damped = inner.clone();
            let at = StateRef {
                u: &step.lagged[..],
                v: &step.w,
            };
            for term in &self.terms {
                term.elastic_forces(chunk, &step.u, &mut inner);
                term.damping_forces(chunk, at, &mut damped);
            }
            for (n, i) in own.enumerate() {
                let inertia = scale(-self.masses[i], step.inertia[i]);
                let parts = [inertia, loads[n], inner[n], damped[n]];
                forces.net[i] = parts.into_iter().fold(zero(), add);
                if self.free_mask[i] > 0.0 {
                    let lengths = parts.iter().map(|f| to_dvec(*f).length());
                    forces.largest = lengths.fold(forces.largest, f64::max);
                }
            }
        }
        forces
    }

    /// Returns the largest net force on a node or a rigid body over the largest force.
    fn relative_residual(&self, forces: &NetForces) -> f64 {
        let mut net = self.restrict_forces(&forces.net);
        if let Some(newton) = &self.newton {
            let of_bodies = net[3 * self.soft_nodes()..].chunks_exact_mut(6);
            for (own, body) in of_bodies.zip(&newton.rigid.bodies) {
                own[3..].iter_mut().for_each(|m| *m /= body.radius());
            }
        }
        let lengths = net.chunks_exact(3).map(|f| DVec3::from_slice(f).length());
        match forces.largest > 0.0 {
            true => lengths.fold(0.0, f64::max) / forces.largest,
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
