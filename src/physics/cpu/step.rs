//! Steps of a body: propose, weigh, judge, accept.

use super::body::{CpuBody, Start};
use super::explicit::{self, From};
use super::guard::{Failure, Sums};
use super::implicit::Scene;
use super::real::Real;
use super::sum::Sources;
use super::terms::At;
use crate::physics::{SolverKind, StepRecord};
use std::sync::Arc;

impl<T: Real> CpuBody<T> {
    /// Takes `steps` steps of `h` seconds. Returns what is noted of the last: energies in J, of
    /// implicit Euler the iterations and the relative residual. Threads are woken once for all.
    ///
    /// # Errors
    /// Why a step was refused; the body stands as it stood before that one. How many were taken
    /// is what [`CpuBody::steps`] counts.
    pub fn run(&mut self, steps: u32, h: f64) -> Result<StepRecord, Failure> {
        let local = h / self.units.time;
        let fits = T::of(local);
        if !(h > 0.0 && h.is_finite() && fits > T::ZERO && (T::ONE / fits).wide().is_finite()) {
            return Err(Failure::BadStep { h });
        }
        let plan = Arc::clone(&self.plan);
        plan.enter(|| {
            self.begin()?;
            let mut record = self.record(0, 0.0);
            for _ in 0..steps {
                record = self.advance(local)?;
            }
            Ok(record)
        })
    }

    /// Steps taken since the body was made.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    pub(super) fn record(&self, iterations: u32, residual: f64) -> StepRecord {
        let joules = self.units.energy();
        StepRecord {
            iterations,
            residual,
            kinetic: self.guard.last.kinetic * joules,
            elastic: self.guard.last.elastic * joules,
        }
    }

    /// Computes the forces of a state that was changed from outside.
    fn begin(&mut self) -> Result<(), Failure> {
        if self.start == Start::Ready {
            return Ok(());
        }
        let restart = self.start == Start::Restart;
        if restart {
            self.lag = 0.0;
        }
        let verlet = self.kind == SolverKind::VelocityVerlet;
        if verlet && restart {
            self.now.seen.copy_from_slice(&self.now.v);
        }
        if restart {
            self.clear_tools();
        }
        let sources = Sources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let v = if verlet { &self.now.seen } else { &self.now.v };
        let at = At { u: &self.now.u, v };
        let sums = sources.forces(at, &mut self.now.f);
        // What nodes that are led do to the body is no work of loads.
        if restart || self.leads() {
            self.guard.restart(sums)?;
        }
        self.start = Start::Ready;
        Ok(())
    }

    /// One step of `h` local units.
    fn advance(&mut self, h: f64) -> Result<StepRecord, Failure> {
        if let Some(done) = self.advance_newton(h) {
            return done;
        }
        let step = T::of(h);
        let (mut iterations, mut residual) = (0, 0.0);
        if self.kind.is_implicit() {
            (iterations, residual) = self.propose_implicit(step)?;
        } else {
            self.propose_explicit(h);
        }
        let sums = self.weigh(step);
        let (nodes, joules) = (self.rest.len(), self.units.energy());
        self.guard.judge(sums, h, nodes, joules)?;
        std::mem::swap(&mut self.now, &mut self.next);
        if let Some(implicit) = &mut self.implicit {
            implicit.solver.keep();
        }
        self.lag = h;
        self.steps += 1;
        Ok(self.record(iterations, residual))
    }

    fn from(&self) -> From<'_, T> {
        From {
            u: &self.now.u,
            v: &self.now.v,
            f: &self.now.f,
            inverse: &self.inverse,
        }
    }

    fn propose_explicit(&mut self, h: f64) {
        let kick = 0.5 * (self.lag + h);
        let mut next = std::mem::take(&mut self.next);
        let w = match self.kind {
            SolverKind::VelocityVerlet => &mut next.seen,
            _ => &mut next.v,
        };
        let lengths = [h, kick].map(T::of);
        explicit::propose(
            &self.plan,
            self.kind,
            lengths,
            self.from(),
            (&mut next.u, w),
        );
        self.next = next;
    }

    fn propose_implicit(&mut self, h: T) -> Result<(u32, f64), Failure> {
        let Some(implicit) = &mut self.implicit else {
            return Ok((0, 0.0));
        };
        let at = At {
            u: &self.now.u,
            v: &self.now.v,
        };
        let scene = Scene {
            plan: &self.plan,
            masses: &self.masses,
            free: &self.free,
            rest: &self.rest_local,
            at,
            f: &self.now.f,
        };
        let outcome = implicit.solve(&scene, &mut self.terms, h);
        let acceptable = implicit.settings.acceptable;
        if outcome.residual.is_nan() {
            return Err(Failure::NonFinite);
        }
        if !outcome.met && outcome.residual > acceptable {
            return Err(Failure::NotConverged {
                iterations: outcome.iterations,
                residual: outcome.residual,
            });
        }
        let next = (&mut self.next.u[..], &mut self.next.v[..]);
        implicit.advance(&self.plan, at, h, next);
        Ok((outcome.iterations, outcome.residual))
    }

    /// Forces and energies of the proposed state.
    fn weigh(&mut self, h: T) -> Sums {
        let sources = Sources {
            plan: &self.plan,
            masses: &self.masses,
            loads: &self.loads,
            terms: &self.terms,
        };
        let next = &mut self.next;
        if self.kind == SolverKind::VelocityVerlet {
            let before = From {
                u: &self.now.u,
                v: &self.now.v,
                f: &self.now.f,
                inverse: &self.inverse,
            };
            let at = At {
                u: &next.u,
                v: &next.seen,
            };
            sources.finish_velocity_verlet(at, &mut next.f, &mut next.v, h, before)
        } else {
            let at = At {
                u: &next.u,
                v: &next.v,
            };
            sources.forces(at, &mut next.f)
        }
    }
}
