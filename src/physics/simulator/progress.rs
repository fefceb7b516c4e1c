//! Progress of the steps of a body.

/// Progress of a solver.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepProgress {
    /// Completed steps since the solver was created.
    pub steps: u64,
    /// Simulated time, s.
    pub time: f64,
    /// The last step.
    pub last: StepRecord,
}

/// One step, as recorded by the engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepRecord {
    /// Iterations of conjugate gradients; 0 for explicit solvers.
    pub iterations: u32,
    /// Their relative residual, √(rᵀD⁻¹r / bᵀD⁻¹b) with D the diagonal blocks.
    pub residual: f64,
    /// Kinetic energy, J (in f32; for Verlet, of the mean velocity over the step).
    pub kinetic: f64,
    /// Elastic energy, J (in f32).
    pub elastic: f64,
}
