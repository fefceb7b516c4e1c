//! The time integrators in float64: references of the solvers of `physics`.

use super::linear::{Solution, conjugate_gradients};
use super::springs::ReferenceSprings;
use crate::physics::SolverKind;
use crate::{Error, Result};
use glam::DVec3;

/// A time integrator in float64, with the state that it keeps between steps.
#[derive(Clone, Debug)]
pub struct ReferenceIntegrator {
    kind: SolverKind,
    tolerance: f64,
    verlet: Verlet,
    velocity_verlet: VelocityVerlet,
}

impl ReferenceIntegrator {
    /// Creates the integrator `kind`; `tolerance` is the relative residual of implicit steps.
    pub fn new(kind: SolverKind, tolerance: f64) -> ReferenceIntegrator {
        ReferenceIntegrator {
            kind,
            tolerance,
            verlet: Verlet::default(),
            velocity_verlet: VelocityVerlet::default(),
        }
    }

    /// Advances `p` by one step of `h` seconds.
    ///
    /// # Errors
    /// [`Error::Input`] for a scheme that does not support springs, or if the conjugate gradients of
    /// an implicit step do not converge.
    pub fn step(&mut self, p: &mut ReferenceSprings, h: f64) -> Result<()> {
        match self.kind {
            SolverKind::Explicit => explicit_euler(p, h),
            SolverKind::Symplectic => symplectic_euler(p, h),
            SolverKind::Verlet => self.verlet.step(p, h),
            SolverKind::VelocityVerlet => self.velocity_verlet.step(p, h),
            SolverKind::Implicit => {
                let solved = implicit_euler(p, h, self.tolerance);
                solved.ok_or_else(|| {
                    Error::Input(format!(
                        "conjugate gradients of the implicit reference did not reach a relative \
                        residual of {:e} in 20 iterations per node; increase the tolerance",
                        self.tolerance
                    ))
                })?;
            }
            kind => {
                return Err(Error::Input(format!(
                    "the reference of springs has no scheme {kind}; use explicit, symplectic, \
                    verlet, velocity-verlet or implicit"
                )));
            }
        }
        Ok(())
    }
}

/// Explicit Euler: x' = x + h v, v' = v + h a.
fn explicit_euler(p: &mut ReferenceSprings, h: f64) {
    let a = accelerations(p);
    let v = p.v.clone();
    update_positions(p, h, &v);
    update_velocities(p, h, &a);
}

/// Symplectic Euler: v' = v + h a, x' = x + h v'.
fn symplectic_euler(p: &mut ReferenceSprings, h: f64) {
    let a = accelerations(p);
    update_velocities(p, h, &a);
    let v = p.v.clone();
    update_positions(p, h, &v);
}

/// Verlet, x' = 2x − x₋₁ + h² a. Damping forces use the velocity (x − x₋₁)/h, which lags by half a
/// step, so a damped motion is only first-order accurate.
#[derive(Clone, Debug, Default)]
struct Verlet {
    previous: Option<Vec<DVec3>>,
}

impl Verlet {
    /// Advances one step; the first starts from x₋₁ = x₀ − h v₀ + ½h² a₀. Stores (x' − x)/h in
    /// `p.v`.
    fn step(&mut self, p: &mut ReferenceSprings, h: f64) {
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

/// Velocity Verlet: x' = x + h (v + ½h a), v' = v + ½h (a + a'), a' = a(x', v + h a), which is kept
/// for the next step. Second-order accurate with and without damping.
#[derive(Clone, Debug, Default)]
struct VelocityVerlet {
    acceleration: Option<Vec<DVec3>>,
}

impl VelocityVerlet {
    /// Advances one step.
    fn step(&mut self, p: &mut ReferenceSprings, h: f64) {
        let a = self.acceleration.take().unwrap_or_else(|| accelerations(p));
        let start = p.v.clone();
        update_velocities(p, 0.5 * h, &a);
        let middle = p.v.clone();
        update_positions(p, h, &middle);
        update_velocities(p, 0.5 * h, &a);
        let next = accelerations(p);
        p.v = start;
        update_velocities(p, 0.5 * h, &a);
        update_velocities(p, 0.5 * h, &next);
        self.acceleration = Some(next);
    }
}

/// Implicit Euler after Baraff & Witkin: (M − h ∂f/∂v − h² K̃) Δv = h (f + h K̃ v) by conjugate
/// gradients to the relative residual `tolerance`; v' = v + Δv, x' = x + h v'.
///
/// Returns the number of iterations, or `None` if 20 per node did not suffice.
fn implicit_euler(p: &mut ReferenceSprings, h: f64, tolerance: f64) -> Option<u32> {
    let most = 20 * p.x.len() as u32;
    let solution = solve_implicit(p, h, tolerance, most);
    if solution.residual > tolerance {
        return None;
    }
    advance_implicit(p, h, &solution.x);
    Some(solution.iterations)
}

fn solve_implicit(p: &ReferenceSprings, h: f64, tolerance: f64, most: u32) -> Solution {
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
    let product = |d: &[DVec3]| p.system_product(h, d);
    let blocks = p.system_blocks(h);
    conjugate_gradients(product, &blocks, &p.pinned, b, tolerance, most)
}

fn advance_implicit(p: &mut ReferenceSprings, h: f64, change: &[DVec3]) {
    update_velocities(p, 1.0, change);
    let v = p.v.clone();
    update_positions(p, h, &v);
}

fn accelerations(p: &ReferenceSprings) -> Vec<DVec3> {
    let masses = &p.model.masses;
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

fn update_velocities(p: &mut ReferenceSprings, h: f64, a: &[DVec3]) {
    for (i, v) in p.v.iter_mut().enumerate() {
        *v = if p.pinned[i] {
            DVec3::ZERO
        } else {
            *v + h * a[i]
        };
    }
}

fn update_positions(p: &mut ReferenceSprings, h: f64, v: &[DVec3]) {
    for (i, x) in p.x.iter_mut().enumerate() {
        if !p.pinned[i] {
            *x += h * v[i];
        }
    }
}
