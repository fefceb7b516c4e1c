//! Termination criteria of the iterations of implicit steps.

/// Termination criterion of conjugate gradients. Residuals are relative: √(rᵀD⁻¹r / bᵀD⁻¹b), D the
/// diagonal blocks.
///
/// The default tolerance, 10⁻³, costs an oscillating bar (`benches/steps.rs`) 1.5 · 10⁻⁵ of its
/// path in 60 steps; 10⁻² costs 2 · 10⁻⁴ of it and two thirds of the iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CgSettings {
    /// The residual to reach.
    pub tolerance: f64,
    /// The residual that is still taken when the iterations run out; above it the step fails.
    pub acceptable: f64,
    /// Iterations a step at most.
    pub max_iterations: u32,
}

impl Default for CgSettings {
    fn default() -> Self {
        CgSettings {
            tolerance: 1e-3,
            acceptable: 5e-2,
            max_iterations: 2000,
        }
    }
}
