//! The potentials of contact and friction, per unit of what weighs them, with two derivatives.

/// The gap over which the barrier is its logarithm; nearer it goes on by its second derivative.
const QUADRATIC_BELOW_TOOL: f64 = 0.2;

/// The same between two parts of a boundary.
const QUADRATIC_BELOW_SELF: f64 = 1e-3;

/// The smoothly clamped log barrier of incremental potential contact, b(g) = −(g − 1)² ln g for
/// g < 1, of the gap over the one from which on it acts (Li et al. 2020, "Incremental Potential
/// Contact", equation 6). Below g = 0.2 it goes on as a parabola: so points may be inside a tool
/// between two iterations of Newton's method, which then finds those that touch at once, and none
/// is in the end where the pressure is less than [`Barrier::BARRIER_FORCE_AT_ZERO_GAP`] times the stiffness.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct Barrier {
    /// b.
    pub value: f64,
    /// b', which is negative.
    pub first_derivative: f64,
    /// b'', which is positive.
    pub second_derivative: f64,
}

impl Barrier {
    /// −b' at g = 0.
    #[cfg(test)]
    pub const BARRIER_FORCE_AT_ZERO_GAP: f64 = 12.8;

    /// At the gap `g`, as tools have it.
    pub fn clamped(g: f64) -> Barrier {
        Barrier::from(g, QUADRATIC_BELOW_TOOL)
    }

    /// At the gap `g` between two parts of a boundary: these never pass each other, so that it is a
    /// logarithm nearly all the way.
    pub fn unclamped(g: f64) -> Barrier {
        Barrier::from(g, QUADRATIC_BELOW_SELF)
    }

    /// At the gap `g`, as a parabola below `near`.
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

/// The smoothed |v| of friction that holds below the speed ε (Li et al. 2020, equations 13 and
/// 15): |v| from there on, and v²/ε − v³/3ε² + ε/3 below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct FrictionMollifier {
    /// What |v| is made of it.
    pub value: f64,
    /// The slope over v.
    pub slope_over_speed: f64,
    /// The second derivative.
    pub bend: f64,
}

/// What slides resists as if this part of it stuck, in systems whose matrix must be positive: or it
/// would slide back and forth.
const MIN_SLIDING_STIFFNESS_RATIO: f64 = 0.1;

impl FrictionMollifier {
    /// At the speed `v`, which holds below `least`.
    pub fn at(v: f64, least: f64) -> FrictionMollifier {
        let y = v / least;
        if y >= 1.0 {
            return FrictionMollifier {
                value: v,
                slope_over_speed: 1.0 / v,
                bend: 0.0,
            };
        }
        FrictionMollifier {
            value: least * (y * y - y * y * y / 3.0 + 1.0 / 3.0),
            slope_over_speed: (2.0 - y) / least,
            bend: (2.0 - 2.0 * y) / least,
        }
    }

    /// The second derivative as a matrix has it that must be positive.
    pub fn projected_hessian(&self) -> f64 {
        self.bend
            .max(MIN_SLIDING_STIFFNESS_RATIO * self.slope_over_speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function, its slope and its second derivative at a place.
    type Curve = dyn Fn(f64) -> [f64; 3];

    fn check(f: &Curve, at: &[f64]) {
        for x in at {
            let h = 1e-6 * x;
            let ([low, s, _], [high, t, _]) = (f(x - h), f(x + h));
            let [_, slope, bend] = f(*x);
            let (by_value, by_slope) = ((high - low) / (2.0 * h), (t - s) / (2.0 * h));
            assert!(
                (by_value - slope).abs() < 1e-6 * slope.abs().max(1e-3),
                "{x}"
            );
            assert!((by_slope - bend).abs() < 1e-6 * bend.abs().max(1e-3), "{x}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_potentials() {
        let barrier = |g: f64| {
            let b = Barrier::clamped(g);
            [b.value, b.first_derivative, b.second_derivative]
        };
        check(&barrier, &[1e-3, 0.1, 0.3, 0.5, 0.9, 0.999, 1.5]);
        let slip = |v: f64| {
            let s = FrictionMollifier::at(v, 0.2);
            [s.value, s.slope_over_speed * v, s.bend]
        };
        let between = |g: f64| {
            let b = Barrier::unclamped(g);
            [b.value, b.first_derivative, b.second_derivative]
        };
        check(&between, &[1e-4, 2e-3, 0.1, 0.5, 1.5]);
        check(&slip, &[1e-3, 0.1, 0.19, 0.21, 3.0]);
    }

    #[test]
    fn it_pushes_from_the_gap_on_and_ever_more() {
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
