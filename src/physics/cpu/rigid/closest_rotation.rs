//! Rotation that best fits one set of points to another.

use glam::{DMat3, DQuat, DVec3};

/// Largest number of Newton steps; four or five are usual.
const MAX_ITERATIONS: usize = 60;

/// Returns the rotation R near `start` that maximises Σ m x·R y, for `m` = Σ m x yᵀ, and so
/// minimises Σ m |x − R y|². Only rotations permitted by the projection `within` are made.
///
/// Newton's method on the rotation vector, with the Hessian tr(C) I − sym C with C = m Rᵀ; where
/// that is not positive definite, short steps along the torque.
pub(in crate::physics) fn closest_rotation(m: &DMat3, start: DQuat, within: DMat3) -> DQuat {
    let mut turn = start;
    let rest = DMat3::IDENTITY - within;
    for _ in 0..MAX_ITERATIONS {
        let c = *m * DMat3::from_quat(turn).transpose();
        let torque = DVec3::new(
            c.y_axis.z - c.z_axis.y,
            c.z_axis.x - c.x_axis.z,
            c.x_axis.y - c.y_axis.x,
        );
        let torque = within * torque;
        let trace = c.x_axis.x + c.y_axis.y + c.z_axis.z;
        let bend = DMat3::from_diagonal(DVec3::splat(trace)) - (c + c.transpose()) * 0.5;
        // Excluded axes get a diagonal entry of suitable magnitude.
        let bend = within * bend * within + rest * trace.abs();
        let step = match is_positive(&bend) {
            true => bend.inverse() * torque,
            false => torque / (trace.abs() + torque.length()),
        };
        let step = step.clamp_length_max(1.0);
        if !step.is_finite() {
            break;
        }
        turn = (DQuat::from_scaled_axis(step) * turn).normalize();
        if step.length_squared() < 1e-30 {
            break;
        }
    }
    turn
}

fn is_positive(m: &DMat3) -> bool {
    let [x, y] = [m.x_axis, m.y_axis];
    let minor = x.x * y.y - x.y * y.x;
    let scale = x.x + y.y + m.z_axis.z;
    let tiny = 1e-12 * scale;
    x.x > tiny && minor > tiny * tiny && m.determinant() > tiny * tiny * scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::cpu::body::tests::noise;

    #[test]
    fn closest_rotation_converges_from_nearby_start() {
        let mut next = noise(4);
        let mut vector = |size: f64| size * DVec3::new(next(), next(), next());
        for n in 0..60 {
            let points: Vec<DVec3> = (0..6).map(|_| vector(1.0)).collect();
            let truth = DQuat::from_scaled_axis(vector(2.5));
            let noise = if n % 2 == 0 { 0.0 } else { 0.05 };
            let mut m = DMat3::ZERO;
            for p in &points {
                let x = truth * *p + vector(noise);
                m += DMat3::from_cols(x * p.x, x * p.y, x * p.z);
            }
            let start = DQuat::from_scaled_axis(vector(1.0)) * truth;
            let found = closest_rotation(&m, start, DMat3::IDENTITY);
            let value = |q: DQuat| {
                let r = DMat3::from_quat(q);
                (0..3).map(|k| r.col(k).dot(m.col(k))).sum::<f64>()
            };
            if noise == 0.0 {
                assert!(found.angle_between(truth) < 1e-7);
            }
            // There is no better rotation nearby.
            for _ in 0..8 {
                let other = DQuat::from_scaled_axis(vector(1e-3)) * found;
                assert!(value(other) < value(found) + 1e-12);
            }
        }
    }

    #[test]
    fn constrained_rotation_keeps_free_axis() {
        let axis = DVec3::new(0.6, 0.0, 0.8);
        let within = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        let truth = DQuat::from_axis_angle(axis, 0.7) * DQuat::from_axis_angle(DVec3::Y, 0.2);
        let m = DMat3::from_quat(truth);
        let found = closest_rotation(&m, DQuat::IDENTITY, within);
        let (about, angle) = found.to_axis_angle();
        assert!(about.cross(axis).length() < 1e-9 && (angle - 0.7).abs() < 0.1);
    }
}
