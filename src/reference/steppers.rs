//! The time integrators in float64: the twins of `physics`' solvers.

use super::springs::Particles;
use glam::{DMat3, DVec3};

/// Explicit Euler: x' = x + h v, v' = v + h a.
pub fn explicit_euler(p: &mut Particles, h: f64) {
    let a = accelerations(p);
    let v = p.v.clone();
    drift(p, h, &v);
    kick(p, h, &a);
}

/// Symplectic Euler: v' = v + h a, x' = x + h v'.
pub fn symplectic_euler(p: &mut Particles, h: f64) {
    let a = accelerations(p);
    kick(p, h, &a);
    let v = p.v.clone();
    drift(p, h, &v);
}

/// Verlet, x' = 2x − x₋₁ + h² a, with damping forces from the velocity (x − x₋₁)/h: half a step
/// old, which makes a damped motion right to first order only.
#[derive(Clone, Debug, Default)]
pub struct Verlet {
    previous: Option<Vec<DVec3>>,
}

impl Verlet {
    /// One step; the first begins with x₋₁ = x₀ − h v₀ + ½h² a₀. Leaves (x' − x)/h in `p.v`.
    pub fn step(&mut self, p: &mut Particles, h: f64) {
        let a = accelerations(p);
        let previous = self.previous.take().unwrap_or_else(|| {
            (0..p.x.len())
                .map(|i| p.x[i] - h * p.v[i] + 0.5 * h * h * a[i])
                .collect()
        });
        let x = p.x.clone();
        for i in 0..x.len() {
            if p.pinned[i] {
                p.v[i] = DVec3::ZERO;
            } else {
                p.x[i] = 2.0 * x[i] - previous[i] + h * h * a[i];
                p.v[i] = (p.x[i] - x[i]) / h;
            }
        }
        self.previous = Some(x);
    }
}

/// Velocity Verlet: x' = x + h (v + ½h a), v' = v + ½h (a + a'), a' = a(x', v + h a), which is
/// kept for the next step. Right to second order, damped or not.
#[derive(Clone, Debug, Default)]
pub struct VelocityVerlet {
    acceleration: Option<Vec<DVec3>>,
}

impl VelocityVerlet {
    /// One step.
    pub fn step(&mut self, p: &mut Particles, h: f64) {
        let a = self.acceleration.take().unwrap_or_else(|| accelerations(p));
        let start = p.v.clone();
        kick(p, 0.5 * h, &a);
        let middle = p.v.clone();
        drift(p, h, &middle);
        kick(p, 0.5 * h, &a);
        let next = accelerations(p);
        p.v = start;
        kick(p, 0.5 * h, &a);
        kick(p, 0.5 * h, &next);
        self.acceleration = Some(next);
    }
}

/// Implicit Euler after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h (f + h K̃ v) by conjugate
/// gradients to the relative residual `tolerance`; v' = v + Δv, x' = x + h v'.
///
/// Returns the iterations it took, or `None` when 20 a node were not enough.
pub fn implicit_euler(p: &mut Particles, h: f64, tolerance: f64) -> Option<u32> {
    let f = p.forces();
    let kv = p.stiffness_product(&p.v, true);
    let b: Vec<DVec3> = (0..f.len())
        .map(|i| {
            if p.pinned[i] {
                DVec3::ZERO
            } else {
                h * (f[i] + h * kv[i])
            }
        })
        .collect();
    let (change, iterations) = conjugate_gradients(p, h, b, tolerance)?;
    kick(p, 1.0, &change);
    let v = p.v.clone();
    drift(p, h, &v);
    Some(iterations)
}

/// Solves A x = b, preconditioned by the inverse diagonal blocks.
fn conjugate_gradients(
    p: &Particles,
    h: f64,
    b: Vec<DVec3>,
    tolerance: f64,
) -> Option<(Vec<DVec3>, u32)> {
    let inverse: Vec<DMat3> = p
        .system_blocks(h)
        .iter()
        .zip(&p.pinned)
        .map(|(block, pinned)| {
            if *pinned {
                DMat3::ZERO
            } else {
                block.inverse()
            }
        })
        .collect();
    let precondition =
        |r: &[DVec3]| -> Vec<DVec3> { r.iter().zip(&inverse).map(|(r, m)| *m * *r).collect() };
    let mut x = vec![DVec3::ZERO; b.len()];
    let mut r = b;
    let mut z = precondition(&r);
    let mut direction = z.clone();
    let mut rz = dot(&r, &z);
    let start = rz;
    for iteration in 0..20 * x.len() as u32 {
        if rz <= tolerance * tolerance * start {
            return Some((x, iteration));
        }
        let q = p.system_product(h, &direction);
        let alpha = rz / dot(&direction, &q);
        for i in 0..x.len() {
            x[i] += alpha * direction[i];
            r[i] -= alpha * q[i];
        }
        z = precondition(&r);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        for i in 0..x.len() {
            direction[i] = z[i] + beta * direction[i];
        }
    }
    None
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

fn accelerations(p: &Particles) -> Vec<DVec3> {
    let masses = &p.network.masses;
    p.forces()
        .iter()
        .enumerate()
        .map(|(i, f)| {
            if p.pinned[i] {
                DVec3::ZERO
            } else {
                *f / masses[i]
            }
        })
        .collect()
}

fn kick(p: &mut Particles, h: f64, a: &[DVec3]) {
    for (i, v) in p.v.iter_mut().enumerate() {
        *v = if p.pinned[i] {
            DVec3::ZERO
        } else {
            *v + h * a[i]
        };
    }
}

fn drift(p: &mut Particles, h: f64, v: &[DVec3]) {
    for (i, x) in p.x.iter_mut().enumerate() {
        if !p.pinned[i] {
            *x += h * v[i];
        }
    }
}
