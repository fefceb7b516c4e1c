//! Textures of a skin: normal maps and height maps.

use crate::files;
use crate::gpu::Gpu;
use crate::{Error, Result};
use std::path::Path;

/// An 8-bit RGBA image mapped to a skin by its texture coordinates: (0, 0) is the lower left
/// corner, (1, 1) the upper right one; it repeats outside.
///
/// A normal map stores unit vectors n in tangent space as (n + 1) / 2: red along the tangent, green
/// along the second texture coordinate, blue along the normal. A height map stores heights in its
/// first channel: 255 is the surface, 0 the deepest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Map {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// RGBA, row by row from the top.
    pub texels: Vec<[u8; 4]>,
}

/// Maximum side length, which every WebGPU device supports.
const MAX_SIDE: u32 = 8192;

impl Map {
    /// Reads a PNG.
    ///
    /// # Errors
    /// An error if the file cannot be read, is not a PNG, or is larger than 8192 texels a side.
    pub fn read(path: impl AsRef<Path>) -> Result<Map> {
        Map::read_file(path.as_ref())
    }

    fn read_file(path: &Path) -> Result<Map> {
        let bytes = files::read(path)?;
        let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes));
        reader.set_format(image::ImageFormat::Png);
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE), Some(MAX_SIDE));
        reader.limits(limits);
        let picture = reader
            .decode()
            .map_err(|e| Error::format(path, format!("not a valid PNG: {e}")))?
            .into_rgba8();
        Ok(Map {
            size: [picture.width(), picture.height()],
            texels: picture.pixels().map(|p| p.0).collect(),
        })
    }

    /// Writes a PNG.
    ///
    /// # Errors
    /// An error if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        self.save_file(path.as_ref())
    }

    fn save_file(&self, path: &Path) -> Result<()> {
        self.check()?;
        let mut file = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut file);
        let [width, height] = self.size;
        image::ImageEncoder::write_image(
            encoder,
            self.texels.as_flattened(),
            width,
            height,
            image::ExtendedColorType::Rgba8,
        )
        .map_err(|e| Error::format(path, format!("cannot encode the image: {e}")))?;
        crate::io::atomic_write(path, |to| {
            std::io::Write::write_all(to, &file).map_err(Error::io(path))
        })
    }

    fn check(&self) -> Result<()> {
        let [width, height] = self.size;
        let right = self.texels.len() as u64 == u64::from(width) * u64::from(height);
        if !right || self.size.iter().any(|n| !(1..=MAX_SIDE).contains(n)) {
            return Err(Error::Input(format!(
                "map size must be 1 to {MAX_SIDE} texels per side and match the number of texels, got {width} x {height} with {} texels",
                self.texels.len()
            )));
        }
        Ok(())
    }

    /// Uploads the map as a texture.
    pub(super) fn upload(&self, gpu: &Gpu) -> Result<wgpu::TextureView> {
        self.check()?;
        let view = gpu.target(
            "map of a skin",
            self.size,
            wgpu::TextureFormat::Rgba8Unorm,
            wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        )?;
        gpu.queue().write_texture(
            view.texture().as_image_copy(),
            self.texels.as_flattened(),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * self.size[0]),
                rows_per_image: None,
            },
            view.texture().size(),
        );
        gpu.poll_errors()?;
        Ok(view)
    }
}
