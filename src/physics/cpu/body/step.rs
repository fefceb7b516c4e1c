//! Time steps of a body: propose, evaluate, check, accept.

use super::explicit::{self, ExplicitInput};
use super::force_assembly::ForceSources;
use super::{CpuBody, ForceStatus};
use crate::physics::cpu::implicit::linear_step::StepContext;
use crate::physics::cpu::implicit::trial_state::has_inverted_tets;
use crate::physics::cpu::runtime::energy_guard::{StepFailure, StepTotals};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::{SolverKind, StepRecord};
use std::sync::Arc;

impl<T: Real> CpuBody<T> {
    /// Takes `steps` steps of `h` seconds. Returns the record of the last: energies in J and, for
    /// implicit Euler, the iterations and the relative residual. Threads are woken once for all
    /// steps.
    ///
    /// # Errors
    /// The reason a step was rejected; the body keeps its state from before that step.
    /// [`CpuBody::steps`] counts the accepted ones.
    pub fn run(&mut self, steps: u32, h: f64) -> Result<StepRecord, StepFailure> {
        let local = h / self.units.time;
        let fits = T::from_f64(local);
        if !(h > 0.0 && h.is_finite() && fits > T::ZERO && (T::ONE / fits).to_f64().is_finite()) {
            return Err(StepFailure::BadStep { h });
        }
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            self.prepare_forces()?;
            let mut record = self.record(0, 0.0);
            for _ in 0..steps {
                record = self.advance(local)?;
            }
            Ok(record)
        })
    }

    /// Returns the number of steps taken since the body was made.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    pub(in crate::physics::cpu) fn record(&self, iterations: u32, residual: f64) -> StepRecord {
        let joules = self.units.energy();
        StepRecord {
            iterations,
            residual,
            kinetic: self.guard.last.kinetic * joules,
            elastic: self.guard.last.elastic * joules,
        }
    }

    /// Recomputes the forces of a state that was changed from outside.
    pub(super) fn prepare_forces(&mut self) -> Result<(), StepFailure> {
        if self.start == ForceStatus::Ready {
            return Ok(());
        }
        self.inversion.invalidate();
        let restart = self.start == ForceStatus::Restart;
        if restart {
            self.previous_dt = 0.0;
        }
        let verlet = self.kind == SolverKind::VelocityVerlet;
        if verlet && restart {
            self.state.damping_velocities.copy_from_slice(&self.state.v);
        }
        if restart {
            self.resolve_initial_penetration();
        }
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let v = if verlet {
            &self.state.damping_velocities
        } else {
            &self.state.v
        };
        let at = StateRef {
            u: &self.state.u,
            v,
        };
        let sums = sources.forces(at, &mut self.state.f);
        // The work of prescribed motion is not included in that of the loads.
        if restart || self.has_prescribed_motion() {
            self.guard.restart(sums)?;
        }
        self.start = ForceStatus::Ready;
        Ok(())
    }

    /// Takes one step of `h` local units.
    fn advance(&mut self, h: f64) -> Result<StepRecord, StepFailure> {
        if let Some(done) = self.advance_newton(h) {
            return done;
        }
        let step = T::from_f64(h);
        let (mut iterations, mut residual) = (0, 0.0);
        if self.kind.is_implicit() {
            (iterations, residual) = self.implicit_update(step)?;
        } else {
            self.propose_explicit(h);
        }
        let sums = self.evaluate_forces(step);
        let (nodes, joules) = (self.rest.len(), self.units.energy());
        let inverted = |u| has_inverted_tets(&self.plan, &self.terms, u);
        let mut inversion = self.inversion;
        inversion.check(inverted(&self.next.u), || inverted(&self.state.u))?;
        self.guard.check_step(sums, h, nodes, joules)?;
        self.inversion = inversion;
        std::mem::swap(&mut self.state, &mut self.next);
        if let Some(implicit) = &mut self.implicit {
            implicit.solver.store_solution();
        }
        self.previous_dt = h;
        self.steps += 1;
        Ok(self.record(iterations, residual))
    }

    fn from(&self) -> ExplicitInput<'_, T> {
        ExplicitInput {
            u: &self.state.u,
            v: &self.state.v,
            f: &self.state.f,
            inverse: &self.inverse_masses,
        }
    }

    fn propose_explicit(&mut self, h: f64) {
        let kick = 0.5 * (self.previous_dt + h);
        let mut next = std::mem::take(&mut self.next);
        let w = match self.kind {
            SolverKind::VelocityVerlet => &mut next.damping_velocities,
            _ => &mut next.v,
        };
        let lengths = [h, kick].map(T::from_f64);
        explicit::explicit_update(
            &self.plan,
            self.kind,
            lengths,
            self.from(),
            (&mut next.u, w),
        );
        self.next = next;
    }

    fn implicit_update(&mut self, h: T) -> Result<(u32, f64), StepFailure> {
        let Some(implicit) = &mut self.implicit else {
            return Ok((0, 0.0));
        };
        let at = StateRef {
            u: &self.state.u,
            v: &self.state.v,
        };
        let scene = StepContext {
            plan: &self.plan,
            masses: &self.masses,
            free: &self.free_mask,
            rest: &self.rest_local,
            at,
            f: &self.state.f,
        };
        let outcome = implicit.solve(&scene, &mut self.terms, h);
        let acceptable = implicit.settings.acceptable;
        if outcome.residual.is_nan() {
            return Err(StepFailure::NonFinite);
        }
        if !outcome.converged && outcome.residual > acceptable {
            return Err(StepFailure::NotConverged {
                iterations: outcome.iterations,
                residual: outcome.residual,
            });
        }
        let next = (&mut self.next.u[..], &mut self.next.v[..]);
        implicit.advance(&self.plan, at, h, next);
        Ok((outcome.iterations, outcome.residual))
    }

    /// Computes forces and energies of the proposed state.
    fn evaluate_forces(&mut self, h: T) -> StepTotals {
        let sources = ForceSources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let next = &mut self.next;
        if self.kind == SolverKind::VelocityVerlet {
            let before = ExplicitInput {
                u: &self.state.u,
                v: &self.state.v,
                f: &self.state.f,
                inverse: &self.inverse_masses,
            };
            let at = StateRef {
                u: &next.u,
                v: &next.damping_velocities,
            };
            sources.finish_velocity_verlet(at, &mut next.f, &mut next.v, h, before)
        } else {
            let at = StateRef {
                u: &next.u,
                v: &next.v,
            };
            sources.forces(at, &mut next.f)
        }
    }
}
