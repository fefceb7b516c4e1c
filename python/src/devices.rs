//! GPU devices, cached by adapter.

use crate::errors::Raise;
use palpate::gpu::Gpu;
use pyo3::prelude::*;
use std::collections::HashMap;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Returns the device on the adapter of that name, index or kind. Without one: on the adapter that
/// `PALPATE_ADAPTER` names, or else on the most capable one. A lost device is created again.
pub fn device(py: Python<'_>, adapter: Option<String>) -> PyResult<Gpu> {
    static MADE: OnceLock<Mutex<HashMap<Option<String>, Gpu>>> = OnceLock::new();
    py.detach(|| {
        let made = MADE.get_or_init(Mutex::default);
        let mut made = made.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(gpu) = made.get(&adapter).filter(|gpu| gpu.poll_errors().is_ok()) {
            return Ok(gpu.clone());
        }
        let gpu = match &adapter {
            Some(name) => Gpu::with_adapter(Some(name)),
            None => Gpu::new(),
        }?;
        made.insert(adapter, gpu.clone());
        Ok(gpu)
    })
    .or_raise(py)
}

/// Returns the bytes allocated on the default device so far, and its live allocations and their bytes
/// if the driver reports them. Waits until the device is idle.
#[pyfunction]
pub fn device_memory(py: Python<'_>) -> PyResult<(u64, Option<usize>, Option<u64>)> {
    let gpu = device(py, None)?;
    py.detach(|| {
        gpu.wait()?;
        let report = gpu.device().generate_allocator_report();
        let live = report.as_ref().map(|r| r.allocations.len());
        let bytes = report.map(|r| r.total_allocated_bytes);
        palpate::Result::Ok((gpu.bytes_allocated(), live, bytes))
    })
    .or_raise(py)
}

/// Returns the available graphics adapters.
#[pyfunction]
pub fn adapters(py: Python<'_>) -> Vec<String> {
    py.detach(Gpu::adapters)
}
