//! Assembly of forces, energies and the finiteness check, in one pass over a state.

use super::explicit::{self, ExplicitInput};
use crate::physics::cpu::external_loads::ExternalLoads;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::runtime::energy_guard::StepTotals;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, Term};
use crate::physics::cpu::vectors::dot;
use crate::physics::cpu::vectors::{V4, sum_f64};

/// Speeds are scaled by this before squaring: squared speeds at a wave front would be subnormal,
/// and ten times as slow.
const SPEED_SCALE: f64 = 1048576.0;

/// Sources of the forces.
pub struct ForceSources<'a, T> {
    /// Partition of the nodes.
    pub plan: &'a Partition,
    /// Masses, local units.
    pub masses: &'a [T],
    /// External loads.
    pub loads: &'a ExternalLoads<T>,
    /// Energy terms.
    pub terms: &'a [Box<dyn Term<T>>],
}

impl<T: Real> ForceSources<'_, T> {
    /// Writes the forces at a state into `f`.
    pub fn forces(&self, at: StateRef<'_, T>, f: &mut [V4<T>]) -> StepTotals {
        let none: &mut [V4<T>] = &mut [];
        self.run(at, f, none, None)
    }

    /// Writes the forces at `at`, whose velocities are v + h a, into `f`, and the velocities at the
    /// end of a step of velocity Verlet that began with `before` into `v`.
    pub fn finish_velocity_verlet(
        &self,
        at: StateRef<'_, T>,
        f: &mut [V4<T>],
        v: &mut [V4<T>],
        h: T,
        before: ExplicitInput<'_, T>,
    ) -> StepTotals {
        self.run(at, f, v, Some((h, before)))
    }

    fn run(
        &self,
        at: StateRef<'_, T>,
        f: &mut [V4<T>],
        v: &mut [V4<T>],
        finish: Option<(T, ExplicitInput<'_, T>)>,
    ) -> StepTotals {
        let data = (Nodes(f), Nodes(v));
        let [kinetic, elastic, power, bad] =
            self.plan.for_each_chunk(data, &|chunk, nodes, (f, v)| {
                let (f, v) = (f.0, v.0);
                self.loads
                    .write_forces(self.plan, chunk, self.masses, at.u, f);
                // The terms add their forces to those of the external loads in f, so the power of
                // the loads is computed first; at the end of a velocity Verlet step it is computed
                // with the final velocities.
                let outside = finish.is_none().then(|| power(f, &at.v[nodes.clone()]));
                let mut elastic = 0.0;
                for term in self.terms {
                    elastic += term.forces(chunk, at, f);
                }
                let masses = &self.masses[nodes.clone()];
                let u = &at.u[nodes.clone()];
                let (velocities, power): (&[V4<T>], f64) = match finish {
                    None => (&at.v[nodes], outside.unwrap_or(0.0)),
                    Some((h, before)) => {
                        let mine = ExplicitInput {
                            u: &before.u[nodes.clone()],
                            v: &before.v[nodes.clone()],
                            f: &before.f[nodes.clone()],
                            inverse: &before.inverse[nodes.clone()],
                        };
                        explicit::finish_velocity_verlet(h, mine, f, v);
                        (v, self.external_power(chunk, at, v))
                    }
                };
                let (kinetic, bad) = kinetic_totals(masses, u, velocities, f);
                [kinetic, elastic, power, bad]
            });
        StepTotals {
            kinetic,
            elastic,
            power,
            non_finite: bad,
        }
    }

    /// Returns the power of the external loads for velocities other than those of the forces.
    fn external_power(&self, chunk: usize, at: StateRef<'_, T>, v: &[V4<T>]) -> f64 {
        self.loads.power(self.plan, chunk, self.masses, at.u, v)
    }
}

/// Returns Σ f·v.
pub fn power<T: Real>(f: &[V4<T>], v: &[V4<T>]) -> f64 {
    dot(f, v)
}

/// Returns the kinetic energy, and a sum that is 0 if all values are finite and NaN otherwise.
pub fn kinetic_totals<T: Real>(masses: &[T], u: &[V4<T>], v: &[V4<T>], f: &[V4<T>]) -> (f64, f64) {
    let mut sum = 0.0;
    let mut bad = [T::ZERO; 4];
    let speed = T::from_f64(SPEED_SCALE);
    let states = u.chunks(32).zip(v.chunks(32));
    for ((m, f), (u, v)) in masses.chunks(32).zip(f.chunks(32)).zip(states) {
        let mut lanes = [T::ZERO; 4];
        for ((m, f), (u, v)) in m.iter().zip(f).zip(u.iter().zip(v)) {
            for n in 0..4 {
                let scaled = speed * v[n];
                lanes[n] += *m * scaled * scaled;
                bad[n] += (u[n] + f[n]) * T::ZERO;
            }
        }
        sum += sum_f64(lanes);
    }
    (0.5 * sum / (SPEED_SCALE * SPEED_SCALE), sum_f64(bad))
}
