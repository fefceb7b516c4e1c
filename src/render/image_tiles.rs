//! Rendering of images in tiles of bounded size.

use super::image::Image;
use super::view::ImageRegion;
use crate::gpu::Gpu;
use crate::{Error, Result};

/// Tile side in pixels; larger images are drawn in tiles to bound memory and the duration of a
/// submission.
const TILE: u32 = 1024;

/// Renders an image of four floats per pixel, calling `draw` for each tile with the view to draw
/// into.
///
/// # Errors
/// [`Error::Input`] for a side of 0 or above 65,536; otherwise errors of `draw` and of reading
/// back.
pub(crate) fn draw_in_tiles(
    gpu: &Gpu,
    size: [u32; 2],
    mut draw: impl FnMut(&wgpu::TextureView, ImageRegion) -> Result<()>,
) -> Result<Vec<[f32; 4]>> {
    check_size(size)?;
    let tile = size.map(|n| n.min(TILE));
    let count = size[0] as usize * size[1] as usize;
    let mut pixels: Vec<[f32; 4]> = Vec::new();
    pixels.try_reserve_exact(count).map_err(|_| {
        Error::Input(format!(
            "not enough memory for an image of {} x {} pixels ({:.1} GB); use a smaller image",
            size[0],
            size[1],
            count as f64 * 16e-9
        ))
    })?;
    let view = gpu.target(
        "picture",
        tile,
        wgpu::TextureFormat::Rgba32Float,
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
    )?;
    for y in (0..size[1]).step_by(tile[1] as usize) {
        for x in (0..size[0]).step_by(tile[0] as usize) {
            let window = ImageRegion {
                picture: size,
                corner: [x, y],
                size: tile,
            };
            draw(&view, window)?;
            copy_tile(&mut pixels, window, &gpu.read_texture(view.texture())?);
        }
    }
    Ok(pixels)
}

/// Renders an image of `size` pixels with `samples` × `samples` samples per pixel; `draw` as in
/// [`draw_in_tiles`].
///
/// # Errors
/// As [`draw_in_tiles`], whose limits the samples have to meet.
pub(crate) fn draw_supersampled(
    gpu: &Gpu,
    size: [u32; 2],
    samples: u32,
    draw: impl FnMut(&wgpu::TextureView, ImageRegion) -> Result<()>,
) -> Result<Image> {
    let pixels = draw_in_tiles(gpu, size.map(|n| n.saturating_mul(samples)), draw)?;
    Ok(Image {
        size,
        channels: 4,
        values: downsampled(&pixels, size, samples),
    })
}

/// Averages `samples` × `samples` samples per pixel of an image of `size` pixels.
fn downsampled(fine: &[[f32; 4]], size: [u32; 2], samples: u32) -> Vec<f32> {
    let (n, width) = (samples as usize, size[0] as usize);
    let pixel = |i: usize| {
        let (x, y) = (i % width * n, i / width * n);
        let mut sum = [0.0; 4];
        for (dy, dx) in (0..n).flat_map(|dy| (0..n).map(move |dx| (dy, dx))) {
            let sample = fine[(y + dy) * width * n + x + dx];
            sum.iter_mut().zip(sample).for_each(|(s, v)| *s += v);
        }
        sum.map(|s| s / (n * n) as f32)
    };
    (0..width * size[1] as usize).flat_map(pixel).collect()
}

/// Copies the pixels of `window` into the image, which grows with the rows of tiles so that memory
/// is committed only as it is drawn. The last tiles of a row or column extend beyond the image.
pub(super) fn copy_tile<T: Copy + Default>(picture: &mut Vec<T>, window: ImageRegion, tile: &[T]) {
    let [x, y] = window.corner;
    let [columns, rows] = window.picture.map(|n| n as usize);
    let below = (y + window.size[1]).min(window.picture[1]) as usize;
    if picture.len() < below * columns {
        picture.resize(below * columns, T::default());
    }
    let width = window.size[0].min(window.picture[0] - x) as usize;
    let lines = tile.chunks_exact(window.size[0] as usize);
    for (line, row) in lines.zip(y as usize..rows) {
        let to = row * columns + x as usize;
        picture[to..to + width].copy_from_slice(&line[..width]);
    }
}

/// Rejects images without pixels or above 65,536 pixels per side.
pub(super) fn check_size(size: [u32; 2]) -> Result<()> {
    if size.iter().any(|n| !(1..=65_536).contains(n)) {
        return Err(Error::Input(format!(
            "image size must be 1 to 65536 pixels per side, got {} x {}",
            size[0], size[1]
        )));
    }
    Ok(())
}
