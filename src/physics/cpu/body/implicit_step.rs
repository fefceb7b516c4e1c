//! Implicit steps of bodies with finite elements.

use super::CpuBody;
use super::force_assembly::kinetic_totals;
use crate::physics::StepRecord;
use crate::physics::cpu::implicit::contact_terms::{self_contact_mut, tool_contact};
use crate::physics::cpu::implicit::linear_step::StepContext;
use crate::physics::cpu::implicit::newton::StepInput;
use crate::physics::cpu::implicit::schemes::ImplicitScheme;
use crate::physics::cpu::implicit::trial_state::has_inverted_tets;
use crate::physics::cpu::runtime::energy_guard::{StepFailure, StepTotals};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{scale, sub, zero};
#[cfg(test)]
use crate::{Error, Result, physics::NewtonSettings};

/// The record of a step, or why it was rejected.
type StepResult = std::result::Result<StepRecord, StepFailure>;

impl<T: Real> CpuBody<T> {
    /// Sets when Newton's method of a step stops, for bodies with elements; bodies without
    /// elements, and explicit schemes, ignore it.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid settings.
    #[cfg(test)]
    pub fn set_newton(&mut self, settings: NewtonSettings) -> Result<()> {
        let NewtonSettings {
            iterations,
            tolerance,
            linear_tolerance: linear,
        } = settings;
        let sound =
            iterations > 0 && (0.0..1.0).contains(&tolerance) && linear > 0.0 && linear < 1.0;
        if !sound {
            return Err(Error::Input(format!(
                "invalid Newton settings: tolerance {tolerance}, {iterations} iterations, linear tolerance {linear}; require at least 1 iteration, 0 ≤ tolerance < 1 and 0 < linear tolerance < 1"
            )));
        }
        if let Some(newton) = &mut self.newton {
            newton.settings = settings;
        }
        Ok(())
    }

    /// Sets the implicit scheme of a body with elements; other bodies ignore it. The scheme
    /// restarts.
    #[cfg(test)]
    pub fn set_scheme(&mut self, rule: ImplicitScheme) {
        if let Some(newton) = &mut self.newton {
            newton.rule = rule;
            self.previous_dt = 0.0;
            if let Some(implicit) = &mut self.implicit {
                implicit.clear_history();
            }
        }
    }

    /// Takes one step of `h` local units; `None` if the body has no Newton solver.
    pub(in crate::physics::cpu) fn advance_newton(&mut self, h: f64) -> Option<StepResult> {
        self.set_constraint_velocities(h);
        let done = self.minimise(h);
        self.commit_constraints(matches!(done, Some(Ok(_))));
        self.commit_tools(matches!(done, Some(Ok(_))));
        done
    }

    /// Sets the velocities of constrained nodes that move to new positions in a step of `h`.
    fn set_constraint_velocities(&mut self, h: f64) {
        let over = T::from_f64(1.0 / h);
        for (k, to) in &self.moving_constraints {
            self.state.v[*k] = scale(over, sub(*to, self.state.u[*k]));
        }
    }

    /// Zeroes those velocities, and keeps the new positions if the step was accepted.
    fn commit_constraints(&mut self, sound: bool) {
        for (k, to) in &self.moving_constraints {
            self.state.v[*k] = zero();
            if sound {
                self.state.u[*k] = *to;
            }
        }
        if sound {
            self.moving_constraints.clear();
        }
    }

    fn minimise(&mut self, h: f64) -> Option<StepResult> {
        let (Some(newton), Some(implicit)) = (&mut self.newton, &mut self.implicit) else {
            return None;
        };
        let scene = StepContext {
            plan: &self.plan,
            masses: &self.masses,
            free: &self.free_mask,
            rest: &self.rest_local,
            at: StateRef {
                u: &self.state.u,
                v: &self.state.v,
            },
            f: &self.state.f,
        };
        let outside = StepInput {
            loads: &self.loads,
            inverse: &self.inverse_masses,
            last: self.previous_dt,
        };
        let found = newton.step(implicit, &scene, &mut self.terms, outside, h);
        let Some(descent) = found else {
            return Some(Err(StepFailure::NonFinite));
        };
        if tool_contact(&self.terms)
            .is_some_and(|c| c.exceeds_penetration_limit(&newton.best.displacements))
        {
            return Some(Err(StepFailure::ToolPenetration));
        }
        let own = self_contact_mut(&mut self.terms);
        if newton.prescribed_fraction < 1.0
            || own.is_some_and(|own| own.has_new_intersections(&newton.best.displacements))
        {
            return Some(Err(StepFailure::SelfContactBlocked));
        }
        let next = &mut self.next;
        newton.finish(
            &scene,
            implicit,
            (h, self.previous_dt),
            (&mut next.u, &mut next.v),
        );
        let inverted = |u| has_inverted_tets(&self.plan, &self.terms, u);
        let mut inversion = self.inversion;
        if let Err(failure) = inversion.check(inverted(&next.u), || inverted(&self.state.u)) {
            return Some(Err(failure));
        }
        let mut elastic = descent.elastic;
        if newton.rule == ImplicitScheme::Midpoint {
            let terms = &self.terms;
            [elastic] = self.plan.for_each_chunk((), &|chunk, _, ()| {
                [terms.iter().map(|t| t.energy(chunk, &next.u)).sum()]
            });
        }
        let (masses, u, v) = (&self.masses, &next.u, &next.v);
        let [kinetic, bad] = self.plan.for_each_chunk((), &|_, nodes, ()| {
            let u = &u[nodes.clone()];
            let (kinetic, bad) = kinetic_totals(&masses[nodes.clone()], u, &v[nodes], u);
            [kinetic, bad]
        });
        let sums = StepTotals {
            kinetic,
            elastic,
            power: 0.0,
            non_finite: bad,
        };
        // No runaway check: a step never raises its incremental potential.
        if let Err(failure) = self.guard.check_finite(sums) {
            return Some(Err(failure));
        }
        self.inversion = inversion;
        newton.keep(implicit);
        std::mem::swap(&mut self.state, &mut self.next);
        self.previous_dt = h;
        self.steps += 1;
        Some(Ok(self.record(descent.iterations, descent.residual)))
    }
}
