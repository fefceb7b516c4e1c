//! A picture by light paths that sets in over the frames of a window.

use super::PathTracer;
use super::tone::WHITE;
use crate::gpu::{Gpu, Pass};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path_show.wgsl`.
        pub(super) struct Show {
            pub backdrop: [f32; 4],
            pub size: [u32; 2],
            pub stride: u32,
            pub exposure: f32,
        }
    }
}

/// Side of a tile in pixels: as short a submission as a window waits for on a software driver.
pub(super) const WINDOW_TILE: u32 = 128;
/// Pixels of a row that a copy to a texture begins at a multiple of (256 bytes).
const ROW: u32 = 64;

/// A picture by light paths in progress, tile by tile: the caller draws some tiles a frame, and shows the
/// texture that they are copied to. Nothing is read back.
pub struct ProgressivePaths {
    gpu: Gpu,
    tracer: PathTracer,
    /// The tiles as they are shown.
    shown: Vec<ShownTile>,
    next: usize,
}

struct ShownTile {
    pass: Pass,
    bytes: wgpu::Buffer,
    stride: u32,
}

impl ProgressivePaths {
    pub(crate) fn new(tracer: PathTracer, backdrop: [f32; 4]) -> Result<ProgressivePaths> {
        let gpu = tracer.gpu.clone();
        let mut shown = Vec::with_capacity(tracer.tiles.len());
        for tile in &tracer.tiles {
            let [width, height] = tile.window.size;
            let stride = width.next_multiple_of(ROW);
            let bytes = gpu.buffer("tile of paths", 4 * u64::from(stride) * u64::from(height))?;
            let pass = gpu
                .pass("render/path_show")
                .read(&tile.sums)
                .write(&bytes)
                .params(&gpu_data::Show {
                    backdrop: [backdrop[0], backdrop[1], backdrop[2], WHITE],
                    size: tile.window.size,
                    stride,
                    exposure: tracer.options.exposure as f32,
                })
                .dispatch_workgroups([width.div_ceil(8), height.div_ceil(8), 1])?;
            shown.push(ShownTile {
                pass,
                bytes,
                stride,
            });
        }
        Ok(ProgressivePaths {
            gpu,
            tracer,
            shown,
            next: 0,
        })
    }

    /// Returns the number of tiles of the picture.
    pub fn tiles(&self) -> usize {
        self.shown.len()
    }

    /// Returns the samples that all pixels have; a few more paths of some may be under way.
    pub fn samples(&self) -> u32 {
        self.tracer.samples
    }

    /// Whether the picture has the samples of the scene.
    pub fn is_done(&self) -> bool {
        self.tracer.samples >= self.tracer.options.samples
    }

    /// Draws a sample per pixel of the next `tiles` tiles and copies them to `colour`, a texture of the
    /// picture's size and of eight bits per channel with the usage `COPY_DST`.
    ///
    /// # Errors
    /// [`Error::Input`] for another texture; [`Error::Gpu`] if the device fails.
    pub fn draw(&mut self, colour: &wgpu::Texture, tiles: usize) -> Result<()> {
        if [colour.width(), colour.height()] != self.tracer.size
            || colour.format() != wgpu::TextureFormat::Rgba8Unorm
            || !colour.usage().contains(wgpu::TextureUsages::COPY_DST)
        {
            return Err(Error::Input(
                "light paths are shown on a texture of their size, in Rgba8Unorm with COPY_DST"
                    .into(),
            ));
        }
        for _ in 0..tiles.min(self.shown.len()) {
            if self.is_done() {
                break;
            }
            let (tile, shown) = (&mut self.tracer.tiles[self.next], &self.shown[self.next]);
            tile.params.until = self.tracer.samples + 1;
            let mut work = self.gpu.start_recording();
            tile.pass.set_params(&mut work, &tile.params)?;
            tile.pass.record(&mut work);
            shown.pass.record(&mut work);
            let [x, y] = tile.window.corner;
            let [width, height] = tile.window.size;
            work.encoder().copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo {
                    buffer: &shown.bytes,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(4 * shown.stride),
                        rows_per_image: None,
                    },
                },
                wgpu::TexelCopyTextureInfo {
                    texture: colour,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x, y, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
            );
            work.submit()?;
            self.next = (self.next + 1) % self.shown.len();
            if self.next == 0 {
                self.tracer.samples += 1;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::tests::{Body, picture, soft};
    use super::*;
    use crate::render::{Camera, PathOptions};

    /// Drawn tile by tile, a picture is that of the same samples at once, tone mapped on the CPU.
    #[test]
    fn picture_that_sets_in_matches_one_at_once() {
        let gpu = Gpu::new().unwrap();
        let body = Body::new("ball", 800, |p| p.x, soft());
        // Several tiles, the last of which are narrower than a row of the copy.
        let size = [WINDOW_TILE + 40, WINDOW_TILE + 24];
        let camera = Camera::fit_mesh_in(&body.mesh, size);
        let backdrop = [0.2, 0.5, 0.8, 1.0];
        let options = PathOptions {
            samples: 3,
            ..PathOptions::default()
        };
        let mut caster = body.caster(&gpu);
        let at_once = picture(&mut caster, &camera, size, &options).shown();
        let expected: Vec<f32> = at_once
            .values
            .chunks_exact(4)
            .flat_map(|p| std::array::from_fn::<f32, 3, _>(|k| p[k] + (1.0 - p[3]) * backdrop[k]))
            .collect();
        let usage = wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC;
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let target = gpu.target("picture", size, format, usage).unwrap();
        let mut paths = caster
            .start_progressive_paths(&camera, (size, backdrop), (&options, &[]))
            .unwrap();
        assert_eq!(paths.tiles(), 4);
        let mut most_after = Vec::new();
        while !paths.is_done() {
            paths.draw(target.texture(), 3).unwrap();
            let drawn: Vec<[u8; 4]> = gpu.read_texture(target.texture()).unwrap();
            let most = drawn
                .iter()
                .zip(expected.chunks_exact(3))
                .flat_map(|(d, e)| (0..3).map(move |k| (f32::from(d[k]) / 255.0 - e[k]).abs()))
                .fold(0.0, f32::max);
            most_after.push(most);
        }
        assert_eq!(paths.samples(), 3);
        assert!(
            most_after.last().unwrap() < &(0.6 / 255.0),
            "{most_after:?}"
        );
        // Fewer samples make another picture.
        assert!(most_after[1] > 0.05, "{most_after:?}");
        let other = gpu.target("small", [8, 8], format, usage).unwrap();
        assert!(paths.draw(other.texture(), 1).is_err());
    }
}
