//! Potentials of contact and friction per unit stiffness or force, with two derivatives each.

use glam::{DMat3, DVec3};

/// Relative gap below which the barrier of tools is replaced by its quadratic extension.
const QUADRATIC_BELOW_TOOL: f64 = 0.2;

/// Relative gap below which the barrier of self-contact is replaced by its quadratic extension.
const QUADRATIC_BELOW_SELF: f64 = 1e-3;

/// The clamped log barrier of incremental potential contact, b(g) = −(g − 1)² ln g for g < 1, where
/// g is the gap over the activation gap (Li et al. 2020, "Incremental Potential Contact", equation
/// 6). For tools, a quadratic extension replaces it below g = 0.2. Newton iterates may therefore
/// penetrate a tool, which lets the solver find all touching points at once; converged points do
/// not penetrate while the contact pressure is less than [`Barrier::BARRIER_FORCE_AT_ZERO_GAP`]
/// times the stiffness.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct Barrier {
    /// b(g).
    pub value: f64,
    /// b'(g), negative.
    pub first_derivative: f64,
    /// b''(g), positive.
    pub second_derivative: f64,
}

impl Barrier {
    /// −b' at g = 0.
    #[cfg(test)]
    pub const BARRIER_FORCE_AT_ZERO_GAP: f64 = 12.8;

    /// Evaluates the barrier of tools at the relative gap `g`.
    pub fn clamped(g: f64) -> Barrier {
        Barrier::from(g, QUADRATIC_BELOW_TOOL)
    }

    /// Evaluates the barrier of self-contact at the relative gap `g`. Features never pass each
    /// other, so the quadratic extension starts only at a very small gap.
    pub fn unclamped(g: f64) -> Barrier {
        Barrier::from(g, QUADRATIC_BELOW_SELF)
    }

    /// Evaluates the barrier at the relative gap `g`, with its quadratic extension below `near`.
    fn from(g: f64, near: f64) -> Barrier {
        if g >= 1.0 {
            return Barrier::default();
        }
        if g < near {
            let (from, by) = (Barrier::from(near, near), g - near);
            return Barrier {
                value: from.value
                    + by * (from.first_derivative + 0.5 * by * from.second_derivative),
                first_derivative: from.first_derivative + by * from.second_derivative,
                second_derivative: from.second_derivative,
            };
        }
        let (off, log) = (g - 1.0, g.ln());
        let ratio = off / g;
        Barrier {
            value: -off * off * log,
            first_derivative: -2.0 * off * log - off * ratio,
            second_derivative: -2.0 * log - 4.0 * ratio + ratio * ratio,
        }
    }
}

/// The smoothed speed |v| of Coulomb friction, with static friction approximated below the speed ε
/// (Li et al. 2020, equations 13 and 15): |v| above ε, and v²/ε − v³/3ε² + ε/3 below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct FrictionMollifier {
    /// The smoothed |v|.
    pub value: f64,
    /// The first derivative divided by v.
    pub slope_over_speed: f64,
    /// The second derivative.
    pub second_derivative: f64,
}

/// Lower bound of the tangential stiffness of sliding contacts, over that of sticking ones, in
/// systems whose matrix must be positive definite. Without it, sliding contacts oscillate.
const MIN_SLIDING_STIFFNESS_RATIO: f64 = 0.1;

impl FrictionMollifier {
    /// Evaluates the mollifier at the speed `v`, with the threshold speed ε = `static_speed`.
    pub fn at(v: f64, static_speed: f64) -> FrictionMollifier {
        let y = v / static_speed;
        if y >= 1.0 {
            return FrictionMollifier {
                value: v,
                slope_over_speed: 1.0 / v,
                second_derivative: 0.0,
            };
        }
        FrictionMollifier {
            value: static_speed * (y * y - y * y * y / 3.0 + 1.0 / 3.0),
            slope_over_speed: (2.0 - y) / static_speed,
            second_derivative: (2.0 - 2.0 * y) / static_speed,
        }
    }

    /// Returns the derivative of the force direction, which is [`FrictionMollifier::slope_over_speed`]
    /// times the velocity `slide`, by `slide`.
    pub fn direction_slope(&self, slide: DVec3) -> DMat3 {
        let along = slide.normalize_or_zero();
        let along = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
        DMat3::IDENTITY * self.slope_over_speed
            + along * (self.second_derivative - self.slope_over_speed)
    }

    /// Returns the derivative of [`FrictionMollifier::slope_over_speed`] at the speed `v` by the
    /// threshold speed.
    pub fn slope_by_threshold(v: f64, static_speed: f64) -> f64 {
        match v < static_speed {
            true => 2.0 * (v / static_speed - 1.0) / (static_speed * static_speed),
            false => 0.0,
        }
    }

    /// The second derivative, bounded below so that the Hessian is positive definite.
    pub fn projected_hessian(&self) -> f64 {
        self.second_derivative
            .max(MIN_SLIDING_STIFFNESS_RATIO * self.slope_over_speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function that returns a value, its first and its second derivative at a point.
    type Curve = dyn Fn(f64) -> [f64; 3];

    fn check(f: &Curve, at: &[f64]) {
        for x in at {
            let h = 1e-6 * x;
            let ([low, s, _], [high, t, _]) = (f(x - h), f(x + h));
            let [_, slope, second_derivative] = f(*x);
            let (by_value, by_slope) = ((high - low) / (2.0 * h), (t - s) / (2.0 * h));
            assert!(
                (by_value - slope).abs() < 1e-6 * slope.abs().max(1e-3),
                "{x}"
            );
            assert!(
                (by_slope - second_derivative).abs() < 1e-6 * second_derivative.abs().max(1e-3),
                "{x}"
            );
        }
    }

    #[test]
    fn barrier_derivatives_match_finite_differences() {
        let barrier = |g: f64| {
            let b = Barrier::clamped(g);
            [b.value, b.first_derivative, b.second_derivative]
        };
        check(&barrier, &[1e-3, 0.1, 0.3, 0.5, 0.9, 0.999, 1.5]);
        let slip = |v: f64| {
            let s = FrictionMollifier::at(v, 0.2);
            [s.value, s.slope_over_speed * v, s.second_derivative]
        };
        let between = |g: f64| {
            let b = Barrier::unclamped(g);
            [b.value, b.first_derivative, b.second_derivative]
        };
        check(&between, &[1e-4, 2e-3, 0.1, 0.5, 1.5]);
        check(&slip, &[1e-3, 0.1, 0.19, 0.21, 3.0]);
    }

    #[test]
    fn barrier_force_grows_monotonically_within_gap() {
        assert_eq!(Barrier::clamped(1.0), Barrier::default());
        let mut last = 0.0;
        for k in 0..100 {
            let barrier = Barrier::clamped(1.0 - 0.02 * f64::from(k + 1));
            assert!(
                barrier.first_derivative < last && barrier.second_derivative > 0.0,
                "{k}"
            );
            last = barrier.first_derivative;
        }
        assert!(
            (Barrier::clamped(0.0).first_derivative + Barrier::BARRIER_FORCE_AT_ZERO_GAP).abs()
                < 0.1
        );
        let [below, above] = [0.2 - 1e-12, 0.2 + 1e-12].map(Barrier::clamped);
        assert!((below.second_derivative - above.second_derivative).abs() < 1e-6);
    }
}
