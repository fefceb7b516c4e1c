//! The largest step an explicit scheme can take, from the mesh.

use super::kind::SolverKind;
use super::material::Damping;
use super::network::{Spring, SpringNetwork};
use glam::DVec3;

/// The largest stable time step of `solver` for `network` at rest with these nodes pinned, in
/// seconds; `None` for implicit Euler, which has none.
///
/// From the largest eigenvalues ω² of M⁻¹K and γ of M⁻¹C, by power iteration. Undamped it is 2/ω
/// for the symplectic schemes. With damping h²ω² + 2hγ ≤ 4 is asked for, and h²ω² + 4hγ ≤ 4 of
/// velocity Verlet, whose damping looks half a step further: exact where both belong to the same
/// mode and careful otherwise. Explicit Euler without damping is never stable: 0.
/// A body stretched far from rest may need less.
pub fn largest_stable_step(
    network: &SpringNetwork,
    pinned: &[bool],
    solver: SolverKind,
) -> Option<f64> {
    if solver == SolverKind::Implicit {
        return None;
    }
    let stiffness = |s: &Spring, n: DVec3, w: DVec3| s.stiffness * n * n.dot(w);
    let damping = |s: &Spring, n: DVec3, w: DVec3| {
        network.spring_damping(s)
            * match network.damping_kind {
                Damping::Axial => n * n.dot(w),
                Damping::Relative => w,
            }
    };
    let omega2 = largest_eigenvalue(network, pinned, stiffness);
    let gamma = largest_eigenvalue(network, pinned, damping)
        * match solver {
            SolverKind::VelocityVerlet => 2.0,
            _ => 1.0,
        };
    if omega2 == 0.0 && gamma == 0.0 {
        return Some(f64::INFINITY);
    }
    let symplectic = if omega2 == 0.0 {
        2.0 / gamma
    } else {
        ((gamma * gamma + 4.0 * omega2).sqrt() - gamma) / omega2
    };
    if solver != SolverKind::Explicit {
        return Some(symplectic);
    }
    // h ≤ c/k mode by mode where it swings; κ_d/κ bounds that ratio from below.
    let ratio = network
        .springs
        .iter()
        .filter(|s| s.stiffness > 0.0)
        .map(|s| network.spring_damping(s) / s.stiffness)
        .fold(f64::INFINITY, f64::min);
    Some(ratio.min(symplectic))
}

/// Largest eigenvalue of M⁻¹A, A the sum of the springs' shares, over the nodes that can move.
fn largest_eigenvalue(
    network: &SpringNetwork,
    pinned: &[bool],
    share: impl Fn(&Spring, DVec3, DVec3) -> DVec3,
) -> f64 {
    let weight: Vec<f64> = network
        .masses
        .iter()
        .zip(pinned)
        .map(|(m, p)| if *p || *m <= 0.0 { 0.0 } else { 1.0 / m.sqrt() })
        .collect();
    // Any start with a share of every mode will do; a Weyl sequence is one, and always the same.
    let mut y: Vec<DVec3> = (0..weight.len())
        .map(|i| (DVec3::new(0.5545497, 0.308517, 0.7548777) * (i + 1) as f64).fract() - 0.5)
        .collect();
    let mut eigenvalue = 0.0;
    for _ in 0..2000 {
        let norm = y.iter().map(|y| y.length_squared()).sum::<f64>().sqrt();
        if norm == 0.0 || !norm.is_finite() {
            break;
        }
        let x: Vec<DVec3> = y.iter().zip(&weight).map(|(y, w)| *y / norm * *w).collect();
        y.fill(DVec3::ZERO);
        for s in &network.springs {
            let [i, j] = s.nodes.map(|v| v as usize);
            let n = (network.rest[j] - network.rest[i]).normalize_or_zero();
            let f = share(s, n, x[j] - x[i]);
            y[i] -= f;
            y[j] += f;
        }
        for (y, w) in y.iter_mut().zip(&weight) {
            *y *= *w;
        }
        let next = y.iter().map(|y| y.length_squared()).sum::<f64>().sqrt();
        if (next - eigenvalue).abs() <= 1e-8 * next {
            return next;
        }
        eigenvalue = next;
    }
    eigenvalue
}
