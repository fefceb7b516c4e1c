//! How far the steps of a body are.

/// How far a solver came.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepProgress {
    /// Steps completed since the solver was made.
    pub steps: u64,
    /// Simulated time, s.
    pub time: f64,
    /// The last step.
    pub last: StepRecord,
}

/// One step, as the GPU noted it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepRecord {
    /// Iterations of conjugate gradients; 0 for explicit solvers.
    pub iterations: u32,
    /// Their relative residual, √(rᵀD⁻¹r / bᵀD⁻¹b) with D the diagonal blocks.
    pub residual: f64,
    /// Energy of motion, J (in f32; of Verlet: of the mean velocity over the step).
    pub kinetic: f64,
    /// Energy in the springs, J (in f32).
    pub elastic: f64,
}
