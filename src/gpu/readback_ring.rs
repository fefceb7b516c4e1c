//! A ring of mappable buffers: copies a device buffer after each submit, read when it arrives
//! without blocking, unless requested.

use super::{Gpu, Recorder};
use crate::{Error, Result};
use std::collections::VecDeque;
use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

type Mapped = std::result::Result<(), wgpu::BufferAsyncError>;

/// Maximum number of pending copies recorded for submission by others.
const MAX_PENDING: usize = 4;

/// Pending copies of one small buffer, oldest first.
#[derive(Debug)]
pub(crate) struct ReadbackRing {
    gpu: Gpu,
    bytes: u64,
    free: Vec<wgpu::Buffer>,
    flying: VecDeque<(wgpu::Buffer, Mutexed)>,
    /// Copies recorded for submission by others, with their numbers.
    recorded: VecDeque<(wgpu::Buffer, Mutexed, u64)>,
}

/// A receiver in a mutex, so that the struct can be shared between threads.
type Mutexed = std::sync::Mutex<Receiver<Mapped>>;

impl ReadbackRing {
    /// Creates a ring for a buffer of `bytes` bytes.
    pub fn new(gpu: &Gpu, bytes: u64) -> ReadbackRing {
        ReadbackRing {
            gpu: gpu.clone(),
            bytes,
            free: Vec::new(),
            flying: VecDeque::new(),
            recorded: VecDeque::new(),
        }
    }

    /// Drops the pending copies.
    pub fn clear(&mut self) {
        self.flying.clear();
        self.recorded.clear();
    }

    /// Returns the number of pending copies.
    pub fn in_flight(&self) -> usize {
        self.flying.len()
    }

    /// Submits `work` followed by a copy of `from`.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn submit(&mut self, mut work: Recorder<'static>, from: &wgpu::Buffer) -> Result<()> {
        let staging = self.staging()?;
        let encoder = work.encoder();
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, self.bytes);
        work.submit()?;
        let (sender, receiver) = channel();
        let tell = move |result| {
            // Fails only if the ring was dropped.
            let _ = sender.send(result);
        };
        staging.slice(..).map_async(wgpu::MapMode::Read, tell);
        self.flying.push_back((staging, receiver.into()));
        Ok(())
    }

    fn staging(&mut self) -> Result<wgpu::Buffer> {
        match self.free.pop() {
            Some(staging) => Ok(staging),
            None => self.gpu.staging(self.bytes),
        }
    }

    /// Records a copy of `from`, which [`ReadbackRing::latest`] returns after the caller has
    /// submitted `work`; `number` identifies it. Records nothing if too many copies are pending.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn record(&mut self, work: &mut Recorder, from: &wgpu::Buffer, number: u64) -> Result<()> {
        if self.recorded.len() >= MAX_PENDING {
            return Ok(());
        }
        let staging = self.staging()?;
        let encoder = work.encoder();
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, self.bytes);
        let (sender, receiver) = channel();
        let tell = move |result| {
            // Fails only if the ring was dropped.
            let _ = sender.send(result);
        };
        encoder.map_buffer_on_submit(&staging, wgpu::MapMode::Read, .., tell);
        self.recorded.push_back((staging, receiver.into(), number));
        Ok(())
    }

    /// Returns number and content of the latest copy recorded by [`ReadbackRing::record`] that has
    /// arrived since the last call, or `None`. Drops copies that were never submitted.
    ///
    /// # Errors
    /// As [`Gpu::poll_errors`].
    pub fn latest<T: bytemuck::Pod>(&mut self) -> Result<Option<(u64, Vec<T>)>> {
        if self.recorded.is_empty() {
            return Ok(None);
        }
        self.gpu.poll_errors()?;
        let mut latest = None;
        for (staging, receiver, number) in std::mem::take(&mut self.recorded) {
            let message = match receiver.lock() {
                Ok(receiver) => receiver.try_recv(),
                Err(poisoned) => poisoned.into_inner().try_recv(),
            };
            match message {
                Ok(Ok(())) => {
                    latest = Some((number, content(&staging)?));
                    self.free.push(staging);
                }
                Err(TryRecvError::Empty) => {
                    self.recorded.push_back((staging, receiver, number));
                }
                // Never submitted, or the device is lost, which is reported elsewhere.
                Ok(Err(_)) | Err(TryRecvError::Disconnected) => {}
            }
        }
        Ok(latest)
    }

    /// Returns the oldest copy if it has arrived; blocks for it with `wait`. `None` if no copy is
    /// pending.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub fn next_completed<T: bytemuck::Pod>(&mut self, wait: bool) -> Result<Option<Vec<T>>> {
        let Some((_, receiver)) = self.flying.front_mut() else {
            return Ok(None);
        };
        let receiver = receiver.get_mut().unwrap_or_else(PoisonError::into_inner);
        let lost = |why: String| Error::DeviceLost(why);
        let mapped = if wait && !cfg!(target_arch = "wasm32") {
            self.gpu.count_readback();
            self.gpu.wait()?;
            // Another thread may have polled the device and send the message slightly later.
            receiver.recv().map_err(|e| lost(e.to_string()))?
        } else {
            self.gpu.poll_errors()?;
            match receiver.try_recv() {
                Ok(mapped) => mapped,
                Err(TryRecvError::Empty) if wait => {
                    let why = "a browser cannot block on the device; poll again later";
                    return Err(Error::Gpu(why.into()));
                }
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => {
                    return Err(lost("a read-back was dropped by the device".into()));
                }
            }
        };
        mapped.map_err(|e| lost(e.to_string()))?;
        let Some((staging, _)) = self.flying.pop_front() else {
            return Ok(None);
        };
        let items = content(&staging)?;
        self.free.push(staging);
        Ok(Some(items))
    }
}

/// Returns the content of a mapped buffer and unmaps it.
fn content<T: bytemuck::Pod>(staging: &wgpu::Buffer) -> Result<Vec<T>> {
    let items = {
        let view = staging
            .slice(..)
            .get_mapped_range()
            .map_err(|e| Error::Gpu(e.to_string()))?;
        view.chunks_exact(size_of::<T>())
            .map(bytemuck::pod_read_unaligned)
            .collect()
    };
    staging.unmap();
    Ok(items)
}
