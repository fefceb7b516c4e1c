//! Time steps of a grid body: forces, next positions, and checks.

use super::body::CpuGridBody;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::partition::{Chunks, Nodes, Partition};
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::scalar::Real;
use std::sync::Arc;

/// Distance from rest, in sizes of the body, beyond which a body has diverged.
const MAX_DISTANCE: f64 = 1e4;

/// Coefficients of a Verlet step.
#[derive(Clone, Copy)]
struct VerletCoefficients<T> {
    damping_factor: T,
    /// h²/m of the mean particle, including the damping gain.
    spring: T,
    /// Displacement of a step by gravity, over the length unit.
    gravity_step: [T; 3],
}

impl<T: Real> CpuGridBody<T> {
    /// Takes `steps` steps of `h` seconds: x' = x + ((1 − γh/2)(x − x₋₁) + h² a) / (1 + γh/2).
    ///
    /// # Errors
    /// The reason a step was rejected; the body keeps its state from before that step.
    pub fn run(&mut self, steps: u32, h: f64) -> Result<(), StepFailure> {
        if !(h > 0.0 && h.is_finite() && h * h > 0.0) {
            return Err(StepFailure::BadStep { h });
        }
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| (0..steps).try_for_each(|_| self.step(&plan, h)))
    }

    fn step(&mut self, plan: &Partition, h: f64) -> Result<(), StepFailure> {
        let first = self.previous_dt.is_none();
        if self.previous_dt != Some(h) {
            self.begin(h);
        }
        let gain = 1.0 / (1.0 + 0.5 * self.damping * h);
        let share = if first { 0.5 } else { 1.0 };
        let rate = share * gain * h * h;
        for (kind, k) in self.kinds.iter_mut().zip(self.stiffness) {
            kind.stiffness = T::from_f64(rate * k / self.mean_mass);
        }
        let rates = VerletCoefficients {
            damping_factor: T::from_f64((1.0 - 0.5 * self.damping * h) * gain),
            spring: T::from_f64(rate / self.mean_mass),
            gravity_step: (rate / self.length * self.gravity)
                .to_array()
                .map(T::from_f64),
        };
        self.collect_spring_forces();
        let (kinds, now, before) = (&self.kinds, &self.now, &self.before);
        let (factors, springs) = (&self.factors[..], &self.springs[..]);
        let (inverse, forces, spring_forces) = (&self.inverse, &self.forces, &self.spring_forces);
        let [x, y, z] = self.next.each_mut().map(|a| Nodes(&mut a[..]));
        let data = (Chunks(&mut self.slabs), (x, y, z));
        let [bad, far] = plan.for_each_chunk(data, &|_, nodes, (slabs, (x, y, z))| {
            let Some(slab) = slabs.0.first_mut() else {
                return [0.0; 2];
            };
            slab.spring_forces(nodes.start, kinds, now, factors, springs);
            for (i, f) in spring_forces {
                if nodes.contains(i) {
                    for (axis, f) in f.to_array().iter().enumerate() {
                        slab.forces[axis][*i - nodes.start] += rates.spring * T::from_f64(*f);
                    }
                }
            }
            let mut lost = [T::ZERO; 2];
            for (axis, out) in [x.0, y.0, z.0].into_iter().enumerate() {
                let (now, before, f) = (&now[axis], &before[axis], &slab.forces[axis]);
                let external = forces.as_ref().map(|f| &f[axis][..]);
                for r in &slab.particles {
                    let local = r.start - nodes.start..r.end - nodes.start;
                    let external = external.map(|e| &e[r.clone()]);
                    let state = (&now[r.clone()], &before[r.clone()]);
                    let given = (&f[local.clone()], external, &inverse[r.clone()]);
                    let out = &mut out[local];
                    advance(
                        rates,
                        rates.gravity_step[axis],
                        state,
                        given,
                        out,
                        &mut lost,
                    );
                }
            }
            // Summed over slabs: any nonzero value is a failure.
            [
                lost[0].to_f64(),
                f64::from(u8::from(lost[1].to_f64() > MAX_DISTANCE)),
            ]
        });
        if !bad.is_finite() {
            return Err(StepFailure::NonFinite);
        }
        if far > 0.0 {
            return Err(StepFailure::Diverged);
        }
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.next);
        self.previous_dt = Some(h);
        self.steps += 1;
        Ok(())
    }

    /// Computes the previous positions for a first step, or for a change of the step length.
    fn begin(&mut self, h: f64) {
        let ratio = T::from_f64(self.previous_dt.map_or(0.0, |lag| h / lag));
        // Makes the first step, including damping, second-order accurate.
        let drift = match self.previous_dt {
            None => h * (1.0 + 0.5 * self.damping * h) / self.length,
            Some(_) => 0.0,
        };
        for axis in 0..3 {
            let states = self.before[axis].iter_mut().zip(&self.now[axis]);
            for ((before, now), v) in states.zip(&self.velocities) {
                *before = *now - ratio * (*now - *before) - T::from_f64(drift * v[axis]);
            }
        }
        for axis in 0..3 {
            // Particles that steps do not move must be equal in all three arrays.
            self.next[axis].copy_from_slice(&self.now[axis]);
        }
    }

    /// Collects the target spring forces on particles over the length unit, N/m.
    fn collect_spring_forces(&mut self) {
        let mut spring_forces = std::mem::take(&mut self.spring_forces);
        spring_forces.clear();
        for a in &self.attachments {
            if let NodeConstraint::Spring {
                node,
                target,
                stiffness,
                limit,
            } = *a
            {
                let i = node as usize;
                let x = self.rest[i] + self.displacement(&self.now, i);
                let force = stiffness * (target - x);
                let fraction = (limit / force.length().max(1e-300)).min(1.0);
                spring_forces.push((i, force * fraction / self.length));
            }
        }
        self.spring_forces = spring_forces;
    }
}

/// Computes the next displacements of a run along one axis.
#[inline(always)]
fn advance<T: Real>(
    rates: VerletCoefficients<T>,
    gravity_step: T,
    (now, before): (&[T], &[T]),
    (f, external, inverse): (&[T], Option<&[T]>, &[T]),
    out: &mut [T],
    lost: &mut [T; 2],
) {
    let n = out.len();
    let (now, before, f, inverse) = (&now[..n], &before[..n], &f[..n], &inverse[..n]);
    for m in 0..n {
        let w = inverse[m];
        let mut a = w * f[m] + gravity_step;
        if let Some(e) = external {
            a += w * rates.spring * e[m];
        }
        let step = rates.damping_factor * (now[m] - before[m]) + a;
        out[m] = now[m] + if w > T::ZERO { step } else { T::ZERO };
    }
    let mut lanes = [[T::ZERO; 8]; 2];
    for eight in out.chunks(8) {
        for (k, x) in eight.iter().enumerate() {
            lanes[0][k] += *x * T::ZERO;
            let far = if *x > T::ZERO { *x } else { -*x };
            lanes[1][k] = far.max(lanes[1][k]);
        }
    }
    let [sums, farthest] = lanes;
    for (sum, far) in sums.into_iter().zip(farthest) {
        lost[0] += sum;
        lost[1] = far.max(lost[1]);
    }
}
