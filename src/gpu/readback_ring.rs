//! A ring of mappable buffers: what a buffer on the device holds after each submit, looked at when
//! it arrives and never waited for unless that is asked.

use super::{Gpu, Recorder};
use crate::{Error, Result};
use std::collections::VecDeque;
use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

type Mapped = std::result::Result<(), wgpu::BufferAsyncError>;

/// Copies recorded for others to submit that may be on their way at a time.
const MAX_PENDING: usize = 4;

/// Copies of one small buffer on their way back, oldest first.
#[derive(Debug)]
pub(crate) struct ReadbackRing {
    gpu: Gpu,
    bytes: u64,
    free: Vec<wgpu::Buffer>,
    flying: VecDeque<(wgpu::Buffer, Mutexed)>,
    /// Of copies recorded for others to submit, the numbers that they were given.
    recorded: VecDeque<(wgpu::Buffer, Mutexed, u64)>,
}

/// A receiver that a structure shared among threads can hold.
type Mutexed = std::sync::Mutex<Receiver<Mapped>>;

impl ReadbackRing {
    /// A ring for a buffer of so many bytes.
    pub fn new(gpu: &Gpu, bytes: u64) -> ReadbackRing {
        ReadbackRing {
            gpu: gpu.clone(),
            bytes,
            free: Vec::new(),
            flying: VecDeque::new(),
            recorded: VecDeque::new(),
        }
    }

    /// Forgets the copies on their way.
    pub fn clear(&mut self) {
        self.flying.clear();
        self.recorded.clear();
    }

    /// How many copies are on their way.
    pub fn in_flight(&self) -> usize {
        self.flying.len()
    }

    /// Submits `work`, and after it a copy of `from`.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn submit(&mut self, mut work: Recorder<'static>, from: &wgpu::Buffer) -> Result<()> {
        let staging = self.staging()?;
        let encoder = work.encoder();
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, self.bytes);
        work.submit()?;
        let (sender, receiver) = channel();
        let tell = move |result| {
            // If the ring is gone, nobody asks.
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

    /// Records a copy of `from`, to be looked at with [`ReadbackRing::latest`] after the caller has
    /// submitted `work`; `number` tells it from others. None where enough are on their way.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn record(&mut self, work: &mut Recorder, from: &wgpu::Buffer, number: u64) -> Result<()> {
        if self.recorded.len() >= MAX_PENDING {
            return Ok(());
        }
        let staging = self.staging()?;
        let encoder = work.encoder();
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, self.bytes);
        let (sender, receiver) = channel();
        let tell = move |result| {
            // If the ring is gone, nobody asks.
            let _ = sender.send(result);
        };
        encoder.map_buffer_on_submit(&staging, wgpu::MapMode::Read, .., tell);
        self.recorded.push_back((staging, receiver.into(), number));
        Ok(())
    }

    /// The number and content of the latest copy that [`ReadbackRing::record`] recorded and that has
    /// arrived; none where none has since the last time. Those that were never submitted are
    /// forgotten.
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
            let told = match receiver.lock() {
                Ok(receiver) => receiver.try_recv(),
                Err(poisoned) => poisoned.into_inner().try_recv(),
            };
            match told {
                Ok(Ok(())) => {
                    latest = Some((number, content(&staging)?));
                    self.free.push(staging);
                }
                Err(TryRecvError::Empty) => {
                    self.recorded.push_back((staging, receiver, number));
                }
                // Never submitted, or the device is lost, which others say.
                Ok(Err(_)) | Err(TryRecvError::Disconnected) => {}
            }
        }
        Ok(latest)
    }

    /// The oldest copy, if it has arrived; with `wait` it is waited for. None where none is on its
    /// way.
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
            // Another thread that polls the device may be the one to say so, a moment later.
            receiver.recv().map_err(|e| lost(e.to_string()))?
        } else {
            self.gpu.poll_errors()?;
            match receiver.try_recv() {
                Ok(mapped) => mapped,
                Err(TryRecvError::Empty) if wait => {
                    let why = "a browser cannot wait for the device; look again later";
                    return Err(Error::Gpu(why.into()));
                }
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => {
                    return Err(lost("a copy never came back".into()));
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

/// What a mapped buffer holds; unmaps it.
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
