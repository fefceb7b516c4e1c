//! Implicit rules of which a step is one minimisation.
//!
//! Each finds the displacement δ from the start of the step to where forces are taken, with the
//! velocity w = (δ − b)/γ there, so that M (w − ṽ)/γ = f(x + δ, w): δ is least in
//! ½ |δ − b − γ ṽ|²_M / γ² + E(x + δ) and what damping and loads add.
//!
//! - Euler: γ = h, ṽ = v, b = 0.
//! - BDF2 with ω = h/h₋₁ (Hairer, Nørsett & Wanner 1993, "Solving Ordinary Differential Equations
//!   I", section III.5): γ = h (1 + ω)/(1 + 2ω), and with c = ω²/(1 + 2ω) ṽ = v + c (v − v₋₁),
//!   b = c (x − x₋₁).
//! - Midpoint: γ = ½h, ṽ = v, b = 0; the step ends twice as far, at v' = 2w − v.

/// An implicit rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImplicitScheme {
    /// Implicit Euler: of first order, it damps.
    #[default]
    Euler,
    /// BDF2: of second order, it damps what is fast; its first step is one of Euler's.
    Bdf2,
    /// The implicit midpoint rule: of second order, it keeps the energy of what is linear.
    Midpoint,
}

/// What a rule makes of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepCoefficients {
    /// γ.
    pub gamma: f64,
    /// c.
    pub history: f64,
    /// The time from the start to where forces are taken.
    pub evaluation_time: f64,
    /// How much of the last change of velocity is expected in the mean velocity until there.
    pub velocity_extrapolation: f64,
    /// How much farther than δ the step goes.
    pub end_scale: f64,
}

impl ImplicitScheme {
    /// For a step of length `h` after one of length `last`; 0 for a first one.
    pub fn coefficients(self, h: f64, last: f64) -> StepCoefficients {
        let grows = if last > 0.0 { h / last } else { 0.0 };
        match self {
            ImplicitScheme::Bdf2 if last > 0.0 => StepCoefficients {
                gamma: h * (1.0 + grows) / (1.0 + 2.0 * grows),
                history: grows * grows / (1.0 + 2.0 * grows),
                evaluation_time: h,
                velocity_extrapolation: 0.5 * grows,
                end_scale: 1.0,
            },
            ImplicitScheme::Midpoint => StepCoefficients {
                gamma: 0.5 * h,
                history: 0.0,
                evaluation_time: 0.5 * h,
                velocity_extrapolation: 0.5 * grows,
                end_scale: 2.0,
            },
            _ => StepCoefficients {
                gamma: h,
                history: 0.0,
                evaluation_time: h,
                velocity_extrapolation: grows,
                end_scale: 1.0,
            },
        }
    }
}
