//! The potentials of contact and friction, per unit of what weighs them, with two derivatives.

/// The gap over which the barrier is its logarithm; nearer it goes on by its second derivative.
const NEAR: f64 = 0.2;

/// The same between two parts of a boundary.
const NEAREST: f64 = 1e-3;

/// The smoothly clamped log barrier of incremental potential contact, b(g) = −(g − 1)² ln g for
/// g < 1, of the gap over the one from which on it acts (Li et al. 2020, "Incremental Potential
/// Contact", equation 6). Below g = 0.2 it goes on as a parabola: so points may be inside a tool
/// between two iterations of Newton's method, which then finds those that touch at once, and none
/// is in the end where the pressure is less than [`Barrier::HOLDS`] times the stiffness.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct Barrier {
    /// b.
    pub value: f64,
    /// b', which is negative.
    pub slope: f64,
    /// b'', which is positive.
    pub bend: f64,
}

impl Barrier {
    /// −b' at g = 0.
    #[cfg(test)]
    pub const HOLDS: f64 = 12.8;

    /// At the gap `g`, as tools have it.
    pub fn at(g: f64) -> Barrier {
        Barrier::from(g, NEAR)
    }

    /// At the gap `g` between two parts of a boundary: these never pass each other, so that it is a
    /// logarithm nearly all the way.
    pub fn between(g: f64) -> Barrier {
        Barrier::from(g, NEAREST)
    }

    /// At the gap `g`, as a parabola below `near`.
    fn from(g: f64, near: f64) -> Barrier {
        if g >= 1.0 {
            return Barrier::default();
        }
        if g < near {
            let (from, by) = (Barrier::from(near, near), g - near);
            return Barrier {
                value: from.value + by * (from.slope + 0.5 * by * from.bend),
                slope: from.slope + by * from.bend,
                bend: from.bend,
            };
        }
        let (off, log) = (g - 1.0, g.ln());
        let ratio = off / g;
        Barrier {
            value: -off * off * log,
            slope: -2.0 * off * log - off * ratio,
            bend: -2.0 * log - 4.0 * ratio + ratio * ratio,
        }
    }
}

/// The smoothed |v| of friction that holds below the speed ε (Li et al. 2020, equations 13 and
/// 15): |v| from there on, and v²/ε − v³/3ε² + ε/3 below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct Slip {
    /// What |v| is made of it.
    pub value: f64,
    /// The slope over v.
    pub slope_over: f64,
    /// The second derivative.
    pub bend: f64,
}

/// What slides resists as if this part of it stuck, in systems whose matrix must be positive: or it
/// would slide back and forth.
const SLIDES: f64 = 0.1;

impl Slip {
    /// At the speed `v`, which holds below `least`.
    pub fn at(v: f64, least: f64) -> Slip {
        let y = v / least;
        if y >= 1.0 {
            return Slip {
                value: v,
                slope_over: 1.0 / v,
                bend: 0.0,
            };
        }
        Slip {
            value: least * (y * y - y * y * y / 3.0 + 1.0 / 3.0),
            slope_over: (2.0 - y) / least,
            bend: (2.0 - 2.0 * y) / least,
        }
    }

    /// The second derivative as a matrix has it that must be positive.
    pub fn held(&self) -> f64 {
        self.bend.max(SLIDES * self.slope_over)
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
            let b = Barrier::at(g);
            [b.value, b.slope, b.bend]
        };
        check(&barrier, &[1e-3, 0.1, 0.3, 0.5, 0.9, 0.999, 1.5]);
        let slip = |v: f64| {
            let s = Slip::at(v, 0.2);
            [s.value, s.slope_over * v, s.bend]
        };
        let between = |g: f64| {
            let b = Barrier::between(g);
            [b.value, b.slope, b.bend]
        };
        check(&between, &[1e-4, 2e-3, 0.1, 0.5, 1.5]);
        check(&slip, &[1e-3, 0.1, 0.19, 0.21, 3.0]);
    }

    #[test]
    fn it_pushes_from_the_gap_on_and_ever_more() {
        assert_eq!(Barrier::at(1.0), Barrier::default());
        let mut last = 0.0;
        for k in 0..100 {
            let barrier = Barrier::at(1.0 - 0.02 * f64::from(k + 1));
            assert!(barrier.slope < last && barrier.bend > 0.0, "{k}");
            last = barrier.slope;
        }
        assert!((Barrier::at(0.0).slope + Barrier::HOLDS).abs() < 0.1);
        let [below, above] = [0.2 - 1e-12, 0.2 + 1e-12].map(Barrier::at);
        assert!((below.bend - above.bend).abs() < 1e-6);
    }
}
