//! Implicit schemes whose steps are minimisations.
//!
//! Each finds the displacement δ from the start of the step to where forces are evaluated, with the
//! velocity w = (δ − b)/γ there, so that M (w − ṽ)/γ = f(x + δ, w): δ minimises ½ |δ − b − γ ṽ|²_M
//! / γ² + E(x + δ) plus the potentials of damping and loads.
//!
//! - Euler: γ = h, ṽ = v, b = 0.
//! - BDF2 with ω = h/h₋₁ (Hairer, Nørsett & Wanner 1993, "Solving Ordinary Differential Equations
//!   I", section III.5): γ = h (1 + ω)/(1 + 2ω), and with c = ω²/(1 + 2ω) ṽ = v + c (v − v₋₁),
//!   b = c (x − x₋₁).
//! - Midpoint: γ = ½h, ṽ = v, b = 0; the step ends twice as far, at v' = 2w − v.

/// An implicit scheme.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImplicitScheme {
    /// Implicit Euler: first order, dissipative.
    #[default]
    Euler,
    /// BDF2: second order, damps high frequencies; its first step is an Euler step.
    Bdf2,
    /// Implicit midpoint rule: second order, conserves the energy of linear systems.
    Midpoint,
}

/// Coefficients of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepCoefficients {
    /// γ.
    pub gamma: f64,
    /// c.
    pub history: f64,
    /// Time from the start to the evaluation of forces.
    pub evaluation_time: f64,
    /// Extrapolated fraction of the last velocity change in the mean velocity up to that time.
    pub velocity_extrapolation: f64,
    /// Ratio of the displacement of the step to δ.
    pub end_scale: f64,
}

impl ImplicitScheme {
    /// Returns the coefficients of a step of length `h` after one of length `last`, 0 for a first
    /// step.
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
