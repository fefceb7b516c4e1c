//! Textures other than arrays: render targets, tables, maps.

use super::Gpu;
use crate::Result;

impl Gpu {
    /// Creates a texture of `size` texels (width, height, layers), without mipmaps.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) if it exceeds the device's limits or memory;
    /// [`Error::DeviceLost`](crate::Error::DeviceLost).
    pub fn texture(
        &self,
        label: &str,
        size: [u32; 3],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::Texture> {
        self.texture_of(label, wgpu::TextureDimension::D2, size, format, usage)
    }

    /// Creates a three-dimensional texture: `size` is width, height and depth.
    ///
    /// # Errors
    /// As [`Gpu::texture`].
    pub fn volume_texture(
        &self,
        label: &str,
        size: [u32; 3],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::Texture> {
        self.texture_of(label, wgpu::TextureDimension::D3, size, format, usage)
    }

    fn texture_of(
        &self,
        label: &str,
        dimension: wgpu::TextureDimension,
        [width, height, layers]: [u32; 3],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::Texture> {
        self.create(label, |device| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension,
                format,
                usage,
                view_formats: &[],
            })
        })
    }

    /// Creates a texture of one layer and returns a view of it; the texture is available as
    /// [`texture`](wgpu::TextureView::texture) of the view.
    ///
    /// # Errors
    /// As [`Gpu::texture`].
    pub fn target(
        &self,
        label: &str,
        [width, height]: [u32; 2],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::TextureView> {
        let texture = self.texture(label, [width, height, 1], format, usage)?;
        Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
    }
}
