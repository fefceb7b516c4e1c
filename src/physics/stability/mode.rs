//! A mode of a linearised body, and its step matrices.

use crate::physics::SolverKind;
use glam::{DMat3, DVec3};

/// A damped oscillator ẍ + γ ẋ + λ x = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Squared angular frequency λ = ω², 1/s².
    pub stiffness: f64,
    /// Damping rate γ, 1/s.
    pub damping: f64,
}

impl Mode {
    /// Returns the step matrix of `scheme` for the step `h` in seconds: of (x, v); for Verlet (x,
    /// x₋₁); for velocity Verlet (x, v, a); for BDF2 that of its first step, which is implicit
    /// Euler's. With two variables the third row and column are 0.
    pub fn step_matrix(&self, scheme: SolverKind, h: f64) -> DMat3 {
        let (k, c) = (self.stiffness, self.damping);
        let rows: [[f64; 3]; 2] = match scheme {
            SolverKind::Explicit => [[1.0, h, 0.0], [-h * k, 1.0 - h * c, 0.0]],
            SolverKind::Symplectic => [
                [1.0 - h * h * k, h * (1.0 - h * c), 0.0],
                [-h * k, 1.0 - h * c, 0.0],
            ],
            // The damping velocity is (x − x₋₁)/h.
            SolverKind::Verlet => [[2.0 - h * h * k - h * c, h * c - 1.0, 0.0], [1.0, 0.0, 0.0]],
            SolverKind::VelocityVerlet => {
                let moved = DVec3::new(1.0, h, 0.5 * h * h);
                // The damping velocity is v + h a.
                let a = -k * moved - c * DVec3::new(0.0, 1.0, h);
                let v = DVec3::new(0.0, 1.0, 0.5 * h) + 0.5 * h * a;
                return DMat3::from_cols(moved, v, a).transpose();
            }
            SolverKind::Midpoint => {
                let a = 0.5 * h;
                let g = 1.0 / (1.0 + a * c + a * a * k);
                let back = -2.0 * g * a * k;
                [[1.0 + a * back, h * g, 0.0], [back, 2.0 * g - 1.0, 0.0]]
            }
            SolverKind::Implicit | SolverKind::Bdf2 => {
                let g = 1.0 / (1.0 + h * c + h * h * k);
                [[1.0 - g * h * h * k, g * h, 0.0], [-g * h * k, g, 0.0]]
            }
        };
        let [x, v] = rows.map(DVec3::from);
        DMat3::from_cols(x, v, DVec3::ZERO).transpose()
    }

    /// Returns the spectral radius of [`Mode::step_matrix`]; above 1 the oscillation grows.
    pub fn spectral_radius(&self, scheme: SolverKind, h: f64) -> f64 {
        spectral_radius(self.step_matrix(scheme, h))
    }

    /// Returns the h in seconds above which [`Mode::spectral_radius`] exceeds 1; infinite for
    /// implicit Euler.
    pub fn largest_step(&self, scheme: SolverKind) -> f64 {
        let (k, c) = (self.stiffness, self.damping);
        match scheme {
            SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint => f64::INFINITY,
            // det < 1: h < γ/λ. Overdamped, also 1 + tr + det = 4 − 2hγ + h²λ > 0.
            SolverKind::Explicit if c * c < 4.0 * k => c / k,
            SolverKind::Explicit => 4.0 / (c + (c * c - 4.0 * k).sqrt()),
            // 1 + tr + det = 4 − 2hγ − h²λ > 0.
            SolverKind::Symplectic | SolverKind::Verlet => 4.0 / (c + (c * c + 4.0 * k).sqrt()),
            // Likewise for the cubic at μ = −1: 4 − 4hγ − h²λ > 0.
            SolverKind::VelocityVerlet => 2.0 / (c + (c * c + k).sqrt()),
        }
    }
}

/// The spectral radius of a 3×3 matrix.
fn spectral_radius(m: DMat3) -> f64 {
    let [a, b, c] = m.transpose().to_cols_array_2d();
    let minors = a[0] * b[1] - a[1] * b[0] + a[0] * c[2] - a[2] * c[0] + b[1] * c[2] - b[2] * c[1];
    let (trace, determinant) = (a[0] + b[1] + c[2], m.determinant());
    // μ³ − trace μ² + minors μ − determinant has a real root within Cauchy's bound; dividing it out
    // leaves a quadratic.
    let cubic = |x: f64| ((x - trace) * x + minors) * x - determinant;
    let mut high = 1.0 + trace.abs().max(minors.abs()).max(determinant.abs());
    let mut low = -high;
    // Bisection would never quite reach a root at 0.
    if determinant == 0.0 {
        (low, high) = (0.0, 0.0);
    }
    while low < 0.5 * (low + high) && 0.5 * (low + high) < high {
        match cubic(0.5 * (low + high)) < 0.0 {
            true => low = 0.5 * (low + high),
            false => high = 0.5 * (low + high),
        }
    }
    let half_sum = 0.5 * (trace - high);
    let product = minors - high * (trace - high);
    let discriminant = half_sum * half_sum - product;
    high.abs().max(match discriminant < 0.0 {
        true => product.sqrt(),
        false => half_sum.abs() + discriminant.sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPLICIT: [SolverKind; 4] = [
        SolverKind::Explicit,
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
    ];

    #[test]
    fn spectral_radii_match_known_eigenvalues() {
        let turned = |d: DVec3| {
            let r = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.4);
            r * DMat3::from_diagonal(d) * r.transpose()
        };
        for (d, radius) in [
            (DVec3::new(0.5, -2.0, 1.0), 2.0),
            (DVec3::new(0.5, 0.5, 0.5), 0.5),
            (DVec3::new(-1.0, 0.9, 0.0), 1.0),
        ] {
            // A triple root is accurate to the cube root of the rounding error.
            assert!((spectral_radius(turned(d)) - radius).abs() < 1e-4, "{d}");
        }
        let spiral = DMat3::from_rotation_z(1.0) * 1.5;
        assert!((spectral_radius(spiral) - 1.5).abs() < 1e-12);
    }

    /// The closed forms are the steps at which the spectral radius passes 1, from light to far
    /// overcritical damping.
    #[test]
    fn spectral_radius_crosses_1_at_largest_stable_step() {
        for stiffness in [1.0, 3e4] {
            for ratio in [0.0, 0.01, 0.5, 1.0, 1.99, 2.0, 2.01, 10.0, 300.0] {
                let damping = ratio * f64::sqrt(stiffness);
                let mode = Mode { stiffness, damping };
                for scheme in EXPLICIT {
                    let limit = mode.largest_step(scheme);
                    if scheme == SolverKind::Explicit && ratio == 0.0 {
                        assert_eq!(limit, 0.0);
                        assert!(mode.spectral_radius(scheme, 1e-3) > 1.0);
                        continue;
                    }
                    for f in [0.01, 0.3, 0.7, 0.99] {
                        let r = mode.spectral_radius(scheme, f * limit);
                        assert!(r < 1.0 + 1e-7, "{scheme} {mode:?} at {f}: {r}");
                    }
                    let r = mode.spectral_radius(scheme, 1.01 * limit);
                    assert!(r > 1.0 + 1e-7, "{scheme} {mode:?}: {r}");
                }
                for h in [1e-3, 1.0, 1e3] {
                    let r = mode.spectral_radius(SolverKind::Implicit, h);
                    assert!(r < 1.0, "{mode:?} {h} s: {r}");
                }
            }
        }
    }
}
