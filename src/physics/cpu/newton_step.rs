//! Steps of bodies with finite elements.

use super::body::CpuBody;
use super::guard::{Failure, Sums};
use super::implicit::Scene;
use super::newton::Outside;
use super::newton_contact::{contact, touching_mut};
use super::real::Real;
use super::rules::Rule;
use super::sum::motion;
use super::terms::At;
use super::vectors::{scale, sub, zero};
use crate::physics::StepRecord;
#[cfg(test)]
use crate::{Error, Result, physics::Newton};

/// What is noted of a step, or why it was refused.
type Refusable = std::result::Result<StepRecord, Failure>;

impl<T: Real> CpuBody<T> {
    /// Says when the minimisation of a step of a body of elements stops; bodies without elements,
    /// and explicit schemes, take no notice.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that make no sense.
    #[cfg(test)]
    pub fn set_newton(&mut self, settings: Newton) -> Result<()> {
        let Newton {
            iterations,
            tolerance,
            linear,
        } = settings;
        let sound =
            iterations > 0 && (0.0..1.0).contains(&tolerance) && linear > 0.0 && linear < 1.0;
        if !sound {
            return Err(Error::Input(format!(
                "Newton's method cannot be run to a residual of {tolerance} in {iterations} iterations with linear solves to {linear}: at least one iteration, 0 ≤ tolerance < 1, and 0 < linear < 1"
            )));
        }
        if let Some(newton) = &mut self.newton {
            newton.settings = settings;
        }
        Ok(())
    }

    /// Says by which implicit rule a body of elements steps; others take no notice. The next step
    /// is a first one.
    #[cfg(test)]
    pub fn set_rule(&mut self, rule: Rule) {
        if let Some(newton) = &mut self.newton {
            newton.rule = rule;
            self.lag = 0.0;
            if let Some(implicit) = &mut self.implicit {
                implicit.forget_solutions();
            }
        }
    }

    /// One step of `h` local units; `None` where the body has none of this kind.
    pub(super) fn advance_newton(&mut self, h: f64) -> Option<Refusable> {
        self.set_out(h);
        let done = self.minimise(h);
        self.arrive(matches!(done, Some(Ok(_))));
        self.keep_tools(matches!(done, Some(Ok(_))));
        done
    }

    /// Gives nodes that are held and have to go to their places the velocities that take them there
    /// in a step of `h`.
    fn set_out(&mut self, h: f64) {
        let over = T::of(1.0 / h);
        for (k, to) in &self.underway {
            self.now.v[*k] = scale(over, sub(*to, self.now.u[*k]));
        }
    }

    /// Has them stay there after a step that was sound.
    fn arrive(&mut self, sound: bool) {
        for (k, to) in &self.underway {
            self.now.v[*k] = zero();
            if sound {
                self.now.u[*k] = *to;
            }
        }
        if sound {
            self.underway.clear();
        }
    }

    fn minimise(&mut self, h: f64) -> Option<Refusable> {
        let (Some(newton), Some(implicit)) = (&mut self.newton, &mut self.implicit) else {
            return None;
        };
        let scene = Scene {
            plan: &self.plan,
            masses: &self.masses,
            free: &self.free,
            rest: &self.rest_local,
            at: At {
                u: &self.now.u,
                v: &self.now.v,
            },
            f: &self.now.f,
        };
        let outside = Outside {
            loads: &self.loads,
            inverse: &self.inverse,
            last: self.lag,
        };
        let found = newton.step(implicit, &scene, &mut self.terms, outside, h);
        let Some(descent) = found else {
            return Some(Err(Failure::NonFinite));
        };
        if contact(&self.terms).is_some_and(|c| c.pierced(&newton.best.place)) {
            return Some(Err(Failure::Pierced));
        }
        let own = touching_mut(&mut self.terms);
        if newton.led < 1.0 || own.is_some_and(|own| own.passed(&newton.best.place)) {
            return Some(Err(Failure::Blocked));
        }
        let next = &mut self.next;
        newton.finish(&scene, implicit, (h, self.lag), (&mut next.u, &mut next.v));
        let mut elastic = descent.elastic;
        if newton.rule == Rule::Midpoint {
            let terms = &self.terms;
            [elastic] = self.plan.each((), &|chunk, _, ()| {
                [terms.iter().map(|t| t.energy(chunk, &next.u)).sum()]
            });
        }
        let (masses, u, v) = (&self.masses, &next.u, &next.v);
        let [kinetic, bad] = self.plan.each((), &|_, nodes, ()| {
            let u = &u[nodes.clone()];
            let (kinetic, bad) = motion(&masses[nodes.clone()], u, &v[nodes], u);
            [kinetic, bad]
        });
        let sums = Sums {
            kinetic,
            elastic,
            power: 0.0,
            bad,
        };
        // Nothing runs away: the potential of a step is never raised.
        if let Err(failure) = self.guard.note(sums) {
            return Some(Err(failure));
        }
        newton.keep(implicit);
        std::mem::swap(&mut self.now, &mut self.next);
        self.lag = h;
        self.steps += 1;
        Some(Ok(self.record(descent.iterations, descent.residual)))
    }
}
