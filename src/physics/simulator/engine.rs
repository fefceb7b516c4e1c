//! Engines by name.

use std::fmt;

/// The engine that computes the steps of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// Compute passes on the graphics device.
    Gpu,
    /// Threads on the CPU.
    Cpu,
    /// Soft bodies of rapier, a physics library, on a CPU thread: requires the feature `rapier`.
    Rapier,
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Engine::Gpu => "gpu",
            Engine::Cpu => "cpu",
            Engine::Rapier => "rapier",
        })
    }
}
