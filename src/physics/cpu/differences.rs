//! Derivatives by central differences of fourth order.

use glam::{DMat3, DVec3};

/// Returns the gradient at 0 of a function of a vector, by differences of `step`.
pub(in crate::physics::cpu) fn gradient(step: f64, value: impl Fn(DVec3) -> f64) -> DVec3 {
    let along = |axis: DVec3| {
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|by| value(by * step * axis));
        (8.0 * (c - b) - (d - a)) / (12.0 * step)
    };
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

/// As [`gradient`], of a vector: column j is the derivative by component j.
pub(in crate::physics::cpu) fn jacobian(step: f64, value: impl Fn(DVec3) -> DVec3) -> DMat3 {
    let along = |axis: DVec3| {
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|by| value(by * step * axis));
        (8.0 * (c - b) - (d - a)) / (12.0 * step)
    };
    DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}
