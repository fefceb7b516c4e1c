//! Pictures drawn in parts of bounded size, and put together.

use super::view::ImageRegion;
use crate::gpu::Gpu;
use crate::{Error, Result};

/// Larger pictures are drawn in tiles of this side, so that memory and the time of a submit stay
/// bounded.
const TILE: u32 = 1024;

/// A picture of four floats a pixel, drawn tile by tile with `draw` into the view it is given.
///
/// # Errors
/// [`Error::Input`] for a side of 0 or beyond 65,536; otherwise what `draw` and reading back say.
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
            "a picture of {} x {} pixels takes {:.1} GB, more memory than there is",
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

/// Puts the pixels of `window` into its picture, which grows with the rows of tiles: no memory is
/// touched long before it is drawn. The last tiles of a row or column reach beyond the picture.
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

/// Refuses pictures without pixels or beyond all measure.
pub(super) fn check_size(size: [u32; 2]) -> Result<()> {
    if size.iter().any(|n| !(1..=65_536).contains(n)) {
        return Err(Error::Input(format!(
            "a picture of {} x {} pixels; each side must be from 1 to 65536",
            size[0], size[1]
        )));
    }
    Ok(())
}
