//! Read-back from the GPU: blocking (counted), or asynchronous with polling.

use super::{Array, Gpu};
use crate::{Error, Result};
use std::marker::PhantomData;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Mutex, PoisonError};

/// An asynchronous read-back; see [`Gpu::read_array_async`].
#[derive(Debug)]
pub struct PendingReadback<T> {
    gpu: Gpu,
    /// Staging buffers in order; several if the data exceeds the maximum buffer size.
    parts: Vec<wgpu::Buffer>,
    /// Receives one message per mapped part, in any order.
    mapped: Mutex<Receiver<std::result::Result<(), wgpu::BufferAsyncError>>>,
    /// Number of parts not mapped yet.
    missing: usize,
    /// Bytes of a row without and with padding.
    row: usize,
    padded: usize,
    /// Maximum number of items.
    items: usize,
    kind: PhantomData<T>,
}

impl<T: bytemuck::Pod> PendingReadback<T> {
    /// Returns the data if it has arrived, else `None`. Does not block.
    ///
    /// # Errors
    /// [`Error::DeviceLost`] if it will never arrive; as [`Gpu::poll_errors`].
    pub fn try_take(&mut self) -> Result<Option<Vec<T>>> {
        self.gpu.poll_errors()?;
        let receiver = self
            .mapped
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner);
        while self.missing > 0 {
            match receiver.try_recv() {
                Ok(mapped) => mapped.map_err(|e| Error::DeviceLost(e.to_string()))?,
                Err(TryRecvError::Empty) => return Ok(None),
                Err(e) => return Err(Error::DeviceLost(e.to_string())),
            }
            self.missing -= 1;
        }
        self.take().map(Some)
    }

    /// Blocks until the data has arrived and returns it.
    ///
    /// # Errors
    /// As [`Gpu::wait`]; [`Error::Gpu`] in a browser, which cannot block.
    pub fn wait(mut self) -> Result<Vec<T>> {
        if cfg!(target_arch = "wasm32") {
            let why = "a browser cannot block on a read-back; poll with try_take";
            return Err(Error::Gpu(why.into()));
        }
        self.gpu.count_readback();
        self.gpu.wait()?;
        let receiver = self
            .mapped
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner);
        // Another thread may have polled the device and send the message slightly later.
        for _ in 0..self.missing {
            let mapped = receiver
                .recv()
                .map_err(|e| Error::DeviceLost(e.to_string()))?;
            mapped.map_err(|e| Error::DeviceLost(e.to_string()))?;
        }
        self.take()
    }

    fn take(&mut self) -> Result<Vec<T>> {
        if self.parts.is_empty() {
            let why = "the read-back data have already been taken";
            return Err(Error::Gpu(why.into()));
        }
        let mut items = Vec::with_capacity(self.items);
        for part in std::mem::take(&mut self.parts) {
            let view = part
                .slice(..)
                .get_mapped_range()
                .map_err(|e| Error::Gpu(e.to_string()))?;
            for line in view.chunks_exact(self.padded) {
                let line = line[..self.row].chunks_exact(size_of::<T>());
                items.extend(line.map(bytemuck::pod_read_unaligned::<T>));
            }
        }
        items.truncate(self.items);
        Ok(items)
    }
}

impl Gpu {
    /// Returns all items of `array`.
    ///
    /// # Errors
    /// [`Error::Gpu`] if `T` does not have the size of an item; otherwise as [`Gpu::wait`].
    pub fn read_array<T: bytemuck::Pod>(&self, array: &Array) -> Result<Vec<T>> {
        self.read_array_async(array)?.wait()
    }

    /// As [`Gpu::read_array`] without blocking: reads the state after everything submitted so far;
    /// poll it with [`PendingReadback::try_take`].
    ///
    /// # Errors
    /// [`Error::Gpu`] if `T` does not have the size of an item, or if the device fails.
    pub fn read_array_async<T: bytemuck::Pod>(&self, array: &Array) -> Result<PendingReadback<T>> {
        if size_of::<T>() != array.texel().bytes() as usize {
            return Err(Error::Gpu(format!(
                "cannot read items of {} bytes from an array of {:?}",
                size_of::<T>(),
                array.texel()
            )));
        }
        self.ask_rows(array.texture(), array.rows(), array.len() as usize)
    }

    /// Returns all texels of the first layer of a two-dimensional `texture`, row by row.
    ///
    /// # Errors
    /// [`Error::Gpu`] if `T` does not have the size of a texel; otherwise as [`Gpu::wait`].
    pub fn read_texture<T: bytemuck::Pod>(&self, texture: &wgpu::Texture) -> Result<Vec<T>> {
        self.read_texture_async(texture)?.wait()
    }

    /// As [`Gpu::read_texture`] without blocking; see [`Gpu::read_array_async`].
    ///
    /// # Errors
    /// [`Error::Gpu`] if `T` does not have the size of a texel, or if the device fails.
    pub fn read_texture_async<T: bytemuck::Pod>(
        &self,
        texture: &wgpu::Texture,
    ) -> Result<PendingReadback<T>> {
        let texels = texture.width() as usize * texture.height() as usize;
        self.ask_rows(texture, texture.height(), texels)
    }

    fn ask_rows<T: bytemuck::Pod>(
        &self,
        texture: &wgpu::Texture,
        rows: u32,
        items: usize,
    ) -> Result<PendingReadback<T>> {
        let texel = texture.format().block_copy_size(None).unwrap_or(0);
        if size_of::<T>() != texel as usize {
            return Err(Error::Gpu(format!(
                "cannot read texels of {} bytes from a texture of {:?}",
                size_of::<T>(),
                texture.format()
            )));
        }
        let row = texture.width() * texel;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let most = self.device().limits().max_buffer_size;
        let most_rows = u32::try_from(most / u64::from(padded)).unwrap_or(u32::MAX);
        let mut parts = Vec::new();
        let mut work = self.start_recording();
        for first in (0..rows).step_by(most_rows.max(1) as usize) {
            let height = most_rows.max(1).min(rows - first);
            let staging = self.staging(u64::from(padded) * u64::from(height))?;
            work.encoder().copy_texture_to_buffer(
                wgpu::TexelCopyTextureInfo {
                    origin: wgpu::Origin3d {
                        y: first,
                        ..Default::default()
                    },
                    ..texture.as_image_copy()
                },
                wgpu::TexelCopyBufferInfo {
                    buffer: &staging,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(padded),
                        rows_per_image: None,
                    },
                },
                wgpu::Extent3d {
                    width: texture.width(),
                    height,
                    depth_or_array_layers: 1,
                },
            );
            parts.push(staging);
        }
        work.submit()?;
        Ok(self.pending(parts, (row as usize, padded as usize), items))
    }

    /// Returns the content of `buffer` as a list of `T`.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub fn read_buffer<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>> {
        self.read_prefix(buffer, buffer.size())
    }

    /// Returns the first `bytes` of `buffer`, rounded up to whole words and limited to its size, as
    /// a list of `T`.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub(crate) fn read_prefix<T: bytemuck::Pod>(
        &self,
        buffer: &wgpu::Buffer,
        bytes: u64,
    ) -> Result<Vec<T>> {
        let bytes = bytes.next_multiple_of(4).min(buffer.size());
        let staging = self.staging(bytes)?;
        let mut work = self.start_recording();
        work.encoder()
            .copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
        work.submit()?;
        self.map(&staging)
    }

    pub(super) fn staging(&self, bytes: u64) -> Result<wgpu::Buffer> {
        self.create("read-back", |device| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read-back"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    /// Waits for the device and reads a mappable buffer.
    pub(super) fn map<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>> {
        let bytes = buffer.size() as usize;
        let items = bytes / size_of::<T>();
        self.pending(vec![buffer.clone()], (bytes, bytes), items)
            .wait()
    }

    /// Starts mapping buffers with rows of `row` bytes, `padded` bytes with padding.
    fn pending<T>(
        &self,
        parts: Vec<wgpu::Buffer>,
        (row, padded): (usize, usize),
        items: usize,
    ) -> PendingReadback<T> {
        let (sender, receiver) = channel();
        for part in &parts {
            let sender = sender.clone();
            part.slice(..)
                .map_async(wgpu::MapMode::Read, move |result| {
                    // Fails only if the read-back was dropped.
                    let _ = sender.send(result);
                });
        }
        PendingReadback {
            gpu: self.clone(),
            missing: parts.len(),
            parts,
            mapped: receiver.into(),
            row,
            padded,
            items,
            kind: PhantomData,
        }
    }
}
