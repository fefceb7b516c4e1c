//! Explicit integrators: each computes the next node positions from the state and its forces. The
//! reference is `reference::integrators`.

use crate::physics::SolverKind;
use crate::physics::cpu::partition::{Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, add_scaled};

/// A state and its forces, in local units.
#[derive(Clone, Copy, Debug)]
pub struct ExplicitInput<'a, T> {
    /// Displacements.
    pub u: &'a [V4<T>],
    /// Velocities.
    pub v: &'a [V4<T>],
    /// Forces.
    pub f: &'a [V4<T>],
    /// Inverse masses, 0 for fixed nodes.
    pub inverse: &'a [T],
}

/// Writes the next displacements and velocities; for velocity Verlet the velocities v + h a, at
/// which the damping of the next forces is evaluated.
///
/// `kick` advances Verlet's velocity (x − x₋₁)/h, which lags by half a step: h, or the mean of two
/// step lengths if they differ, which for a first step is ½h.
pub fn explicit_update<T: Real>(
    plan: &Partition,
    kind: SolverKind,
    [h, kick]: [T; 2],
    from: ExplicitInput<'_, T>,
    next: (&mut [V4<T>], &mut [V4<T>]),
) {
    plan.for_each_chunk((Nodes(next.0), Nodes(next.1)), &|_, nodes, (x, w)| {
        let from = ExplicitInput {
            u: &from.u[nodes.clone()],
            v: &from.v[nodes.clone()],
            f: &from.f[nodes.clone()],
            inverse: &from.inverse[nodes],
        };
        match kind {
            SolverKind::Explicit => each(from, x.0, w.0, |u, v, a| {
                (add_scaled(u, h, v), add_scaled(v, h, a))
            }),
            SolverKind::Verlet => each(from, x.0, w.0, |u, v, a| {
                let next = add_scaled(v, kick, a);
                (add_scaled(u, h, next), next)
            }),
            SolverKind::VelocityVerlet => each(from, x.0, w.0, |u, v, a| {
                let middle = add_scaled(v, T::HALF * h, a);
                (add_scaled(u, h, middle), add_scaled(v, h, a))
            }),
            _ => each(from, x.0, w.0, |u, v, a| {
                let next = add_scaled(v, h, a);
                (add_scaled(u, h, next), next)
            }),
        }
        []
    });
}

#[inline(always)]
fn each<T: Real>(
    from: ExplicitInput<'_, T>,
    x: &mut [V4<T>],
    w: &mut [V4<T>],
    advance: impl Fn(V4<T>, V4<T>, V4<T>) -> (V4<T>, V4<T>),
) {
    let forces = from.f.iter().zip(from.inverse);
    let state = from.u.iter().zip(from.v);
    for (((x, w), (u, v)), (f, m)) in x.iter_mut().zip(w).zip(state).zip(forces) {
        (*x, *w) = advance(*u, *v, [*m * f[0], *m * f[1], *m * f[2], *m * f[3]]);
    }
}

/// Finishes a step of velocity Verlet: v' = v + ½h (a + a').
pub fn finish_velocity_verlet<T: Real>(
    h: T,
    before: ExplicitInput<'_, T>,
    f: &[V4<T>],
    v: &mut [V4<T>],
) {
    let half = T::HALF * h;
    let forces = before.f.iter().zip(f).zip(before.inverse);
    for ((out, v), ((a, b), m)) in v.iter_mut().zip(before.v).zip(forces) {
        let k = half * *m;
        let both = [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]];
        *out = add_scaled(*v, k, both);
    }
}
