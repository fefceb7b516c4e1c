//! Reading back, the only way out of the GPU. Every read waits for the device, and is counted.

use super::{Array, Gpu};
use crate::{Error, Result};

impl Gpu {
    /// All items of `array`.
    ///
    /// # Errors
    /// [`Error::Gpu`] when `T` is not an item's size; otherwise as [`Gpu::wait`].
    pub fn read_array<T: bytemuck::Pod>(&self, array: &Array) -> Result<Vec<T>> {
        if size_of::<T>() != array.texel().bytes() as usize {
            return Err(Error::Gpu(format!(
                "items of {} bytes asked of an array of {:?}",
                size_of::<T>(),
                array.texel()
            )));
        }
        let mut items: Vec<T> = self.read_rows(array.texture(), array.rows())?;
        items.truncate(array.len() as usize);
        Ok(items)
    }

    /// All texels of the first layer of a two-dimensional `texture`, row after row.
    ///
    /// # Errors
    /// [`Error::Gpu`] when `T` is not a texel's size; otherwise as [`Gpu::wait`].
    pub fn read_texture<T: bytemuck::Pod>(&self, texture: &wgpu::Texture) -> Result<Vec<T>> {
        self.read_rows(texture, texture.height())
    }

    fn read_rows<T: bytemuck::Pod>(&self, texture: &wgpu::Texture, rows: u32) -> Result<Vec<T>> {
        let texel = texture.format().block_copy_size(None).unwrap_or(0);
        if size_of::<T>() != texel as usize {
            return Err(Error::Gpu(format!(
                "texels of {} bytes asked of a texture of {:?}",
                size_of::<T>(),
                texture.format()
            )));
        }
        let row = texture.width() * texel;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let staging = self.staging(u64::from(padded) * u64::from(rows))?;
        let mut work = self.record();
        work.encoder().copy_texture_to_buffer(
            texture.as_image_copy(),
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
                height: rows,
                depth_or_array_layers: 1,
            },
        );
        work.submit()?;
        let bytes: Vec<u8> = self.map(&staging)?;
        let mut items = Vec::with_capacity((texture.width() * rows) as usize);
        for line in bytes.chunks_exact(padded as usize) {
            let line = &line[..row as usize];
            items.extend(
                line.chunks_exact(size_of::<T>())
                    .map(bytemuck::pod_read_unaligned::<T>),
            );
        }
        Ok(items)
    }

    /// The content of `buffer` as a list of `T`.
    ///
    /// # Errors
    /// As [`Gpu::wait`].
    pub fn read_buffer<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>> {
        let staging = self.staging(buffer.size())?;
        let mut work = self.record();
        work.encoder()
            .copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
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
        if cfg!(target_arch = "wasm32") {
            let why = "a browser cannot wait for what is read back from the device";
            return Err(Error::Gpu(why.into()));
        }
        self.count_readback();
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer
            .slice(..)
            .map_async(wgpu::MapMode::Read, move |result| {
                // The receiver outlives the wait below; if it is gone, nobody asks.
                let _ = sender.send(result);
            });
        self.wait()?;
        receiver
            .recv()
            .map_err(|e| Error::DeviceLost(e.to_string()))?
            .map_err(|e| Error::DeviceLost(e.to_string()))?;
        let view = buffer
            .slice(..)
            .get_mapped_range()
            .map_err(|e| Error::Gpu(e.to_string()))?;
        Ok(view
            .chunks_exact(size_of::<T>())
            .map(bytemuck::pod_read_unaligned)
            .collect())
    }
}
