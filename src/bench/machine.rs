//! The machine of a report.

use crate::gpu::Gpu;
use serde::{Deserialize, Serialize};
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

/// What a report was measured on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Machine {
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Its kind: discrete, integrated, virtual, software or other.
    pub adapter_kind: String,
    /// The graphics interface: Vulkan, Metal, DX12.
    pub backend: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Model of the processor.
    pub cpu: String,
    /// Threads of the CPU engine.
    pub threads: usize,
    /// Memory, GB.
    pub memory_gb: f64,
    /// The operating system with its version, and the architecture.
    pub system: String,
    /// Version of Palpate.
    pub palpate: String,
    /// Whether Palpate was compiled with optimisation (a release build).
    pub optimised: bool,
}

impl Machine {
    /// Returns this machine with the adapter of `gpu`.
    pub fn of(gpu: &Gpu) -> Machine {
        let adapter = gpu.adapter();
        let parts = RefreshKind::nothing()
            .with_memory(MemoryRefreshKind::nothing().with_ram())
            .with_cpu(sysinfo::CpuRefreshKind::nothing());
        let system = System::new_with_specifics(parts).ok();
        let cpu = system.as_ref().and_then(|system| system.cpus().first());
        let cpu = cpu.map(|cpu| cpu.brand().trim()).unwrap_or_default();
        let memory = system.as_ref().map_or(0, System::total_memory);
        let name = System::long_os_version();
        Machine {
            adapter: adapter.name.clone(),
            adapter_kind: match adapter.device_type {
                wgpu::DeviceType::DiscreteGpu => "discrete",
                wgpu::DeviceType::IntegratedGpu => "integrated",
                wgpu::DeviceType::VirtualGpu => "virtual",
                wgpu::DeviceType::Cpu => "software",
                wgpu::DeviceType::Other => "other",
            }
            .into(),
            backend: adapter.backend.to_string(),
            driver: format!("{} {}", adapter.driver, adapter.driver_info)
                .trim()
                .into(),
            cpu: if cpu.is_empty() { "unknown" } else { cpu }.into(),
            threads: rayon::current_num_threads(),
            memory_gb: (memory as f64 * 1e-8).round() / 10.0,
            system: format!(
                "{}, {}",
                name.unwrap_or_else(|_| std::env::consts::OS.into()),
                std::env::consts::ARCH
            ),
            palpate: env!("CARGO_PKG_VERSION").into(),
            optimised: !cfg!(debug_assertions),
        }
    }

    /// Returns the adapter in one line.
    pub fn adapter_line(&self) -> String {
        format!(
            "{} ({}, {}), driver {}",
            self.adapter, self.adapter_kind, self.backend, self.driver
        )
    }
}

/// Returns the memory that programs can still get, in bytes, if the system tells it.
pub(super) fn available_memory() -> Option<u64> {
    let memory = MemoryRefreshKind::nothing().with_ram();
    let parts = RefreshKind::nothing().with_memory(memory);
    let system = System::new_with_specifics(parts).ok()?;
    Some(system.available_memory()).filter(|bytes| *bytes > 0)
}
