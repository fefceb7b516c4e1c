//! One-dimensional arrays on the GPU, stored in two-dimensional textures.
//!
//! Textures, because the workload is dominated by gathers through the texture cache: on the
//! software adapter they are several times faster than storage buffers.

use super::{Bind, Gpu, Recorder, Resource};
use crate::mesh::LocalFrame;
use crate::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/gpu/scatter_u32x4.wgsl`.
        pub struct ScatterParams {
            pub items: u32,
        }
    }
}

/// Texels in a full row of an [`Array`]; must equal the constant in `lib/array.wgsl`. A square
/// texture of this size is the largest that every WebGPU device supports.
pub(crate) const ROW_TEXELS: u32 = 8192;
/// The width of a single-row array is a multiple of this number of texels.
const WIDTH_STEP: u32 = 256;
/// Maximum bytes per upload. Each chunk is submitted separately, so that the staging memory does
/// not grow with the array.
const UPLOAD_CHUNK_BYTES: usize = 32 << 20;
/// Maximum items per scatter: storage buffers of 16 MiB.
const MAX_SCATTER_ITEMS: usize = 1 << 20;

/// Texel format of an [`Array`].
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
    /// Returns the texture format.
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

    /// Returns the bytes per item.
    pub fn bytes(self) -> u32 {
        match self {
            Texel::F32 | Texel::U32 => 4,
            Texel::F32x2 | Texel::U32x2 => 8,
            Texel::F32x4 | Texel::U32x4 => 16,
        }
    }
}

/// Write counter of an array, shared by its clones.
#[derive(Clone, Debug, Default)]
pub struct Version(Arc<AtomicU64>);

impl Version {
    /// Returns the number of writes.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    pub(super) fn next(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// A GPU-resident array of `len` items, item i at texel (i mod 8192, i / 8192).
/// If they fit one row, the texture may be narrower.
///
/// Counts its writes: recorded passes, copies and uploads. Dependants detect changes by comparing
/// [`Array::version`]. Clones share texture and version.
#[derive(Clone, Debug)]
pub struct Array {
    pub(super) texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
    texel: Texel,
    len: u32,
    version: Version,
}

impl Array {
    /// Returns a number that increases with every write.
    pub fn version(&self) -> u64 {
        self.version.get()
    }

    /// Increments the version, for writes to the texture outside of this crate.
    pub fn mark_written(&self) {
        self.version.next();
    }

    /// Returns the number of items.
    pub fn len(&self) -> u32 {
        self.len
    }

    /// Whether there are no items.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the number of items that the texture can hold.
    pub fn capacity(&self) -> u32 {
        self.texture.width() * self.texture.height()
    }

    /// Returns the texel format.
    pub fn texel(&self) -> Texel {
        self.texel
    }

    /// Records a copy of all items from a buffer that has [`Array::capacity`] of them.
    pub(crate) fn copy_from(&self, buffer: &wgpu::Buffer, work: &mut Recorder) {
        self.mark_written();
        work.encoder().copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.texture.width() * self.texel.bytes()),
                    rows_per_image: None,
                },
            },
            self.texture.as_image_copy(),
            self.texture.size(),
        );
    }

    /// Returns the texture, for callers that fill or draw it directly.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// Returns a view of the whole texture.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    pub(super) fn rows(&self) -> u32 {
        self.len.div_ceil(ROW_TEXELS).max(1)
    }
}

/// Returns width and height of the texture for `items`.
pub(crate) fn array_size(items: u32) -> [u32; 2] {
    let width = items.max(1).next_multiple_of(WIDTH_STEP).min(ROW_TEXELS);
    [width, items.div_ceil(ROW_TEXELS).max(1)]
}

impl Bind for Array {
    fn resource(&self) -> Resource<'_> {
        Resource::Texture(&self.view)
    }

    fn version(&self) -> Option<&Version> {
        Some(&self.version)
    }
}

/// Node positions of a mesh on the GPU with their local frame: the interface between simulation and
/// rendering.
#[derive(Clone, Copy, Debug)]
pub struct Positions<'a> {
    /// One item a node, in the mesh's order: xyz in `frame`.
    pub array: &'a Array,
    /// Frame of the positions.
    pub frame: LocalFrame,
}

impl Gpu {
    /// Creates a zeroed array of `len` items.
    ///
    /// # Errors
    /// [`Error::Gpu`] if it exceeds the device's texture size or memory.
    pub fn array(&self, label: &str, texel: Texel, len: usize) -> Result<Array> {
        self.array_with_room(label, texel, len, 0)
    }

    /// As [`Gpu::array`], with spare capacity for at least an eighth and 1,024 items more: see
    /// [`Gpu::resize`].
    ///
    /// # Errors
    /// As [`Gpu::array`].
    pub fn array_with_headroom(&self, label: &str, texel: Texel, len: usize) -> Result<Array> {
        self.array_with_room(label, texel, len, len / 8 + 1024)
    }

    /// Returns the maximum number of items of an [`Array`] on this device.
    pub fn max_items(&self) -> usize {
        // Item indices are u32.
        let rows = (u32::MAX / ROW_TEXELS).min(self.device().limits().max_texture_dimension_2d);
        ROW_TEXELS as usize * rows as usize
    }

    fn array_with_room(&self, label: &str, texel: Texel, len: usize, room: usize) -> Result<Array> {
        let most = self.max_items();
        if len > most {
            return Err(Error::Gpu(format!(
                "array \"{label}\" must have at most {most} items on this device (texture size \
                limit), got {len}; use a smaller mesh"
            )));
        }
        let [width, rows] = array_size(len.saturating_add(room).min(most) as u32);
        let texture = self.texture(
            label,
            [width, rows, 1],
            texel.format(),
            wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
        )?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.count_bytes(u64::from(width) * u64::from(rows) * u64::from(texel.bytes()));
        Ok(Array {
            texture,
            view,
            texel,
            len: len as u32,
            version: Version::default(),
        })
    }

    /// Creates an array with the content `data`.
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

    /// Creates an array with spare capacity (see [`Gpu::array_with_headroom`]) and the content
    /// `data`.
    ///
    /// # Errors
    /// As [`Gpu::array_of`].
    pub fn array_of_with_headroom<T: bytemuck::Pod>(
        &self,
        label: &str,
        texel: Texel,
        data: &[T],
    ) -> Result<Array> {
        let array = self.array_with_headroom(label, texel, data.len())?;
        self.write_array(&array, data)?;
        Ok(array)
    }

    /// Replaces the whole content of `array`; takes effect before the next submit. Large data is
    /// submitted immediately, in chunks.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the number or size of items differs from the array's.
    pub fn write_array<T: bytemuck::Pod>(&self, array: &Array, data: &[T]) -> Result<()> {
        let item = array.texel.bytes();
        if size_of::<T>() != item as usize || data.len() != array.len as usize {
            return Err(Error::Gpu(format!(
                "got {} items of {} bytes for an array of {} items of {item} bytes",
                data.len(),
                size_of::<T>(),
                array.len
            )));
        }
        self.write_items(array, 0, data)
    }

    /// Replaces the items from `first` on; takes effect before the next submit.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the size of items differs from the array's, or they exceed its end.
    pub fn write_items<T: bytemuck::Pod>(
        &self,
        array: &Array,
        first: u32,
        data: &[T],
    ) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let item = array.texel.bytes();
        if size_of::<T>() != item as usize || first as usize + data.len() > array.len as usize {
            return Err(Error::Gpu(format!(
                "cannot write {} items of {} bytes from index {first} of an array of {} items of \
                {item} bytes",
                data.len(),
                size_of::<T>(),
                array.len
            )));
        }
        array.mark_written();
        let count = data.len() as u32;
        // The rest of a partial row, whole rows, then the start of the last row.
        let head = ((ROW_TEXELS - first % ROW_TEXELS) % ROW_TEXELS).min(count);
        let most_rows = (UPLOAD_CHUNK_BYTES as u32 / (ROW_TEXELS * item)).max(1);
        let (mut from, mut pieces) = (0, 0);
        while from < count {
            let at = first + from;
            let [width, rows] = match count - from {
                _ if from < head => [head, 1],
                rest if rest < ROW_TEXELS => [rest, 1],
                rest => [ROW_TEXELS, (rest / ROW_TEXELS).min(most_rows)],
            };
            let to = from + width * rows;
            let part = from as usize * item as usize..to as usize * item as usize;
            pieces += part.len();
            self.write_rows(
                array,
                [at % ROW_TEXELS, at / ROW_TEXELS],
                [width, rows],
                &bytes[part],
            );
            from = to;
            if pieces >= UPLOAD_CHUNK_BYTES {
                self.submit([]);
                pieces = 0;
            }
        }
        Ok(())
    }

    /// Replaces a rectangle of texels.
    fn write_rows(&self, array: &Array, [x, y]: [u32; 2], [width, height]: [u32; 2], bytes: &[u8]) {
        self.queue().write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &array.texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x, y, z: 0 },
                aspect: wgpu::TextureAspect::All,
            },
            bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * array.texel.bytes()),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
    }

    /// Changes the length of `array` to `len` and preserves its items. Reuses the texture if its
    /// capacity suffices; otherwise allocates a new one with spare capacity, which passes prepared
    /// with the old one do not see. Returns whether it reallocated.
    ///
    /// # Errors
    /// As [`Gpu::array`].
    pub fn resize(&self, array: &mut Array, label: &str, len: usize) -> Result<bool> {
        if len <= array.capacity() as usize {
            array.len = len as u32;
            array.mark_written();
            return Ok(false);
        }
        let grown = self.array_with_headroom(label, array.texel, len)?;
        let mut work = self.start_recording();
        work.encoder().copy_texture_to_texture(
            array.texture.as_image_copy(),
            grown.texture.as_image_copy(),
            array.texture.size(),
        );
        work.submit()?;
        // The version continues, so that dependants detect the change.
        grown
            .version
            .0
            .store(array.version() + 1, Ordering::Relaxed);
        *array = grown;
        Ok(true)
    }

    /// Replaces single items of an array of [`Texel::U32x4`], [`Texel::U32x2`] or [`Texel::F32x2`]:
    /// item `places[k]` by `items[k]`. Uploads only these. Takes effect immediately, before later
    /// submits.
    ///
    /// # Errors
    /// [`Error::Gpu`] for another kind of item, lists of different lengths, or an index out of
    /// range.
    pub fn scatter_items<T: bytemuck::Pod>(
        &self,
        array: &Array,
        places: &[u32],
        items: &[T],
    ) -> Result<()> {
        let shader = match array.texel {
            Texel::U32x4 => "gpu/scatter_u32x4",
            Texel::U32x2 => "gpu/scatter_u32x2",
            Texel::F32x2 => "gpu/scatter_f32x2",
            other => {
                return Err(Error::Gpu(format!(
                    "cannot scatter items of {other:?}; supported: U32x4, U32x2, F32x2"
                )));
            }
        };
        let fits = places.iter().all(|p| *p < array.len);
        if size_of::<T>() != array.texel.bytes() as usize || places.len() != items.len() || !fits {
            return Err(Error::Gpu(format!(
                "cannot scatter {} items of {} bytes to {} indices of an array of {} items of {} \
                bytes; sizes and counts must match, and indices must be in range",
                items.len(),
                size_of::<T>(),
                places.len(),
                array.len,
                array.texel.bytes()
            )));
        }
        for (places, items) in places
            .chunks(MAX_SCATTER_ITEMS)
            .zip(items.chunks(MAX_SCATTER_ITEMS))
        {
            let params = gpu_data::ScatterParams {
                items: places.len() as u32,
            };
            let places = self.buffer_of("places", places)?;
            let items = self.buffer_of("items", items)?;
            let pass = self
                .pass(shader)
                .read(&places)
                .read(&items)
                .write(array)
                .params(&params)
                .dispatch_items(params.items)?;
            let mut work = self.start_recording();
            pass.record(&mut work);
            work.submit()?;
        }
        Ok(())
    }

    /// Creates a zeroed buffer for storage, indirect arguments, copies, vertices and indices.
    ///
    /// # Errors
    /// [`Error::Gpu`] if it exceeds the device's limits or memory.
    pub fn buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        let most = self.device().limits().max_buffer_size;
        if bytes > most {
            return Err(Error::Gpu(format!(
                "buffer \"{label}\" must have at most {most} bytes on this device, got {bytes}; \
                use a smaller mesh"
            )));
        }
        let size = bytes.max(4).next_multiple_of(4);
        self.count_bytes(size);
        self.create(label, |device| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
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

    /// Creates a buffer with the content `data`.
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
