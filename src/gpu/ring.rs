//! A ring of mappable buffers: what a buffer on the device holds after each submit, looked at when
//! it arrives and never waited for unless that is asked.

use super::{Gpu, Recorder};
use crate::{Error, Result};
use std::collections::VecDeque;
use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

type Mapped = std::result::Result<(), wgpu::BufferAsyncError>;

/// Copies of one small buffer on their way back, oldest first.
#[derive(Debug)]
pub(crate) struct Ring {
    gpu: Gpu,
    bytes: u64,
    free: Vec<wgpu::Buffer>,
    flying: VecDeque<(wgpu::Buffer, Mutexed)>,
}

/// A receiver that a structure shared among threads can hold.
type Mutexed = std::sync::Mutex<Receiver<Mapped>>;

impl Ring {
    /// A ring for a buffer of so many bytes.
    pub fn new(gpu: &Gpu, bytes: u64) -> Ring {
        Ring {
            gpu: gpu.clone(),
            bytes,
            free: Vec::new(),
            flying: VecDeque::new(),
        }
    }

    /// Forgets the copies on their way.
    pub fn clear(&mut self) {
        self.flying.clear();
    }

    /// How many copies are on their way.
    pub fn flying(&self) -> usize {
        self.flying.len()
    }

    /// Submits `work`, and after it a copy of `from`.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn submit(&mut self, mut work: Recorder<'static>, from: &wgpu::Buffer) -> Result<()> {
        let staging = match self.free.pop() {
            Some(staging) => staging,
            None => self.gpu.staging(self.bytes)?,
        };
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

    /// The oldest copy, if it has arrived; with `wait` it is waited for. None where none is on its
    /// way.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub fn arrived<T: bytemuck::Pod>(&mut self, wait: bool) -> Result<Option<Vec<T>>> {
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
            self.gpu.check()?;
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
        self.free.push(staging);
        Ok(Some(items))
    }
}
