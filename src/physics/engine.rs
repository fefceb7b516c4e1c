//! What computes the steps of a body.

use crate::gpu::Gpu;
use crate::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// What computes the steps of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// Compute passes on the graphics device.
    Gpu,
    /// Threads of the processor.
    Cpu,
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Engine::Gpu => "gpu",
            Engine::Cpu => "cpu",
        })
    }
}

/// Which engine is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The GPU where there is one, else the CPU.
    #[default]
    Auto,
    /// This one.
    This(Engine),
}

impl EngineChoice {
    /// The engine to take beside `gpu`: an adapter that is a processor itself is none.
    pub fn engine(self, gpu: &Gpu) -> Engine {
        match self {
            EngineChoice::This(engine) => engine,
            EngineChoice::Auto if gpu.adapter().device_type == wgpu::DeviceType::Cpu => Engine::Cpu,
            EngineChoice::Auto => Engine::Gpu,
        }
    }
}

impl FromStr for EngineChoice {
    type Err = Error;

    fn from_str(name: &str) -> Result<EngineChoice> {
        match name {
            "auto" => Ok(EngineChoice::Auto),
            "gpu" => Ok(EngineChoice::This(Engine::Gpu)),
            "cpu" => Ok(EngineChoice::This(Engine::Cpu)),
            _ => Err(Error::Input(format!(
                "there is no engine \"{name}\"; there are auto, gpu and cpu"
            ))),
        }
    }
}
