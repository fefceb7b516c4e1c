//! One-dimensional arrays on the GPU, held in two-dimensional textures.
//!
//! Textures because gathers through a texture cache are what this work is made of: on the
//! software adapter they are several times faster than storage buffers.

use super::{Bind, Gpu, Resource};
use crate::{Error, Result};

/// Texels in a row of an [`Array`]; `lib/array.wgsl` has the same number.
pub const ROW: u32 = 4096;

/// What one item of an [`Array`] is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Texel {
    F32,
    F32x2,
    F32x4,
    U32,
    U32x2,
    U32x4,
}

impl Texel {
    /// The texture format that holds it.
    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            Texel::F32 => wgpu::TextureFormat::R32Float,
            Texel::F32x2 => wgpu::TextureFormat::Rg32Float,
            Texel::F32x4 => wgpu::TextureFormat::Rgba32Float,
            Texel::U32 => wgpu::TextureFormat::R32Uint,
            Texel::U32x2 => wgpu::TextureFormat::Rg32Uint,
            Texel::U32x4 => wgpu::TextureFormat::Rgba32Uint,
        }
    }

    /// Bytes in one item.
    pub fn bytes(self) -> u32 {
        match self {
            Texel::F32 | Texel::U32 => 4,
            Texel::F32x2 | Texel::U32x2 => 8,
            Texel::F32x4 | Texel::U32x4 => 16,
        }
    }
}

/// A GPU-resident array of `len` items, item i at texel (i mod [`ROW`], i / [`ROW`]).
#[derive(Clone, Debug)]
pub struct Array {
    pub(super) texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
    texel: Texel,
    len: u32,
}

impl Array {
    /// Number of items.
    pub fn len(&self) -> u32 {
        self.len
    }

    /// Whether there are no items.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// What an item is made of.
    pub fn texel(&self) -> Texel {
        self.texel
    }

    /// The texture, for callers who fill or draw it themselves.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// The whole texture as a view.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    pub(super) fn rows(&self) -> u32 {
        self.len.div_ceil(ROW).max(1)
    }
}

impl Bind for Array {
    fn resource(&self) -> Resource<'_> {
        Resource::Texture(&self.view)
    }
}

impl Gpu {
    /// An array of `len` items, zeroed.
    ///
    /// # Errors
    /// [`Error::Gpu`] when it exceeds the device's texture size or memory.
    pub fn array(&self, label: &str, texel: Texel, len: usize) -> Result<Array> {
        let side = self.device().limits().max_texture_dimension_2d;
        let capacity = u64::from(ROW) * u64::from(side);
        if len as u64 > capacity {
            return Err(Error::Gpu(format!(
                "array \"{label}\" of {len} items exceeds the {capacity} this device can hold in one texture; use a smaller mesh"
            )));
        }
        let rows = (len as u32).div_ceil(ROW).max(1);
        let texture = self.create(label, |device| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: ROW,
                    height: rows,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: texel.format(),
                usage: wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::COPY_SRC
                    | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        })?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Array {
            texture,
            view,
            texel,
            len: len as u32,
        })
    }

    /// An array filled with `data`.
    ///
    /// # Errors
    /// As [`Gpu::array`] and [`Gpu::write_array`].
    pub fn array_of<T: bytemuck::Pod>(
        &self,
        label: &str,
        texel: Texel,
        data: &[T],
    ) -> Result<Array> {
        let array = self.array(label, texel, data.len())?;
        self.write_array(&array, data)?;
        Ok(array)
    }

    /// Replaces the whole content of `array`; it takes effect before the next submit.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the number or size of items differs from the array's.
    pub fn write_array<T: bytemuck::Pod>(&self, array: &Array, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let item = array.texel.bytes();
        if size_of::<T>() != item as usize || data.len() != array.len as usize {
            return Err(Error::Gpu(format!(
                "{} items of {} bytes given for an array of {} items of {item} bytes",
                data.len(),
                size_of::<T>(),
                array.len
            )));
        }
        let full_rows = array.len / ROW;
        let rest = array.len % ROW;
        let split = (full_rows * ROW * item) as usize;
        for (row, rows, width, part) in [
            (0, full_rows, ROW, &bytes[..split]),
            (full_rows, 1, rest, &bytes[split..]),
        ] {
            if part.is_empty() {
                continue;
            }
            self.queue().write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &array.texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y: row, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                part,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(width * item),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width,
                    height: rows,
                    depth_or_array_layers: 1,
                },
            );
        }
        Ok(())
    }

    /// A zeroed buffer for storage, indirect arguments, copies, vertices and indices.
    ///
    /// # Errors
    /// [`Error::Gpu`] when it exceeds the device's limits or memory.
    pub fn buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        self.create(label, |device| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes.max(4).next_multiple_of(4),
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::INDIRECT
                    | wgpu::BufferUsages::VERTEX
                    | wgpu::BufferUsages::INDEX
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    /// A buffer filled with `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn buffer_of<T: bytemuck::Pod>(&self, label: &str, data: &[T]) -> Result<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(label, bytes.len() as u64)?;
        if !bytes.is_empty() {
            self.queue().write_buffer(&buffer, 0, bytes);
        }
        Ok(buffer)
    }
}
