//! GPU time of each pass, by timestamp queries, if the adapter supports them.

use super::Gpu;
use super::device::lock;
use crate::Result;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum number of timed passes per recording. WebGPU limits a query set to 4096 queries.
const TIMED_PASSES: u32 = 2048;

/// Collects the timestamps of every recording made while timing is on.
#[derive(Debug)]
pub(super) struct Timer {
    on: AtomicBool,
    /// Nanoseconds per tick; `None` if the device has no timestamps.
    period: Option<f32>,
    pending: Mutex<Vec<PassTimes>>,
}

/// Names of timed passes, and the mappable buffer that receives their timestamps.
pub(super) type PassTimes = (Vec<String>, wgpu::Buffer);

/// Timestamp queries of one recording.
pub(super) struct TimestampQueries {
    queries: wgpu::QuerySet,
    names: Vec<String>,
}

impl Timer {
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Timer {
        let timed = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        Timer {
            on: AtomicBool::new(false),
            period: timed.then(|| queue.get_timestamp_period()),
            pending: Mutex::default(),
        }
    }

    pub(super) fn begin(&self, device: &wgpu::Device) -> Option<TimestampQueries> {
        let wanted = self.on.load(Ordering::Relaxed) && self.period.is_some();
        wanted.then(|| TimestampQueries {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * TIMED_PASSES,
            }),
            names: Vec::new(),
        })
    }
}

impl Timer {
    /// Stores the times of a submitted recording for [`Gpu::timings`].
    pub(super) fn add(&self, times: PassTimes) {
        lock(&self.pending).push(times);
    }
}

impl TimestampQueries {
    /// Returns the query set and the two query indices of the next pass.
    pub(super) fn next(&mut self, name: &str) -> Option<(wgpu::QuerySet, u32, u32)> {
        let pass = self.names.len() as u32;
        (pass < TIMED_PASSES).then(|| {
            self.names.push(name.to_owned());
            (self.queries.clone(), 2 * pass, 2 * pass + 1)
        })
    }

    /// Records the copy of the timestamps to a mappable buffer; `None` if no pass was timed.
    pub(super) fn resolve(
        self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Option<PassTimes> {
        if self.names.is_empty() {
            return None;
        }
        let count = 2 * self.names.len() as u32;
        let buffer = |usage| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("pass times"),
                size: u64::from(count) * 8,
                usage,
                mapped_at_creation: false,
            })
        };
        let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
        let mappable = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        encoder.resolve_query_set(&self.queries, 0..count, &resolved, 0);
        encoder.copy_buffer_to_buffer(&resolved, 0, &mappable, 0, u64::from(count) * 8);
        Some((self.names, mappable))
    }
}

impl Gpu {
    /// Enables or disables timing for recordings started after this call. Timed passes do not share
    /// a WebGPU pass, which has a small cost.
    pub fn time_passes(&self, on: bool) {
        self.timer().on.store(on, Ordering::Relaxed);
    }

    /// Returns the total milliseconds of each pass, by name, over the recordings submitted since
    /// the last call; empty if the adapter has no timestamps. Waits for the device.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub fn timings(&self) -> Result<BTreeMap<String, f64>> {
        let pending = std::mem::take(&mut *lock(&self.timer().pending));
        let mut times = BTreeMap::new();
        let Some(period) = self.timer().period else {
            return Ok(times);
        };
        for (names, buffer) in pending {
            let ticks: Vec<u64> = self.map(&buffer)?;
            for (name, pair) in names.into_iter().zip(ticks.chunks_exact(2)) {
                let milliseconds =
                    pair[1].saturating_sub(pair[0]) as f64 * f64::from(period) * 1e-6;
                *times.entry(name).or_insert(0.0) += milliseconds;
            }
        }
        Ok(times)
    }
}
