//! Pictures drawn in parts of bounded size, and put together.

use super::view::Window;
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
    mut draw: impl FnMut(&wgpu::TextureView, Window) -> Result<()>,
) -> Result<Vec<[f32; 4]>> {
    check_size(size)?;
    let tile = size.map(|n| n.min(TILE));
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("picture"),
        size: wgpu::Extent3d {
            width: tile[0],
            height: tile[1],
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
    for y in (0..size[1]).step_by(tile[1] as usize) {
        for x in (0..size[0]).step_by(tile[0] as usize) {
            draw(
                &view,
                Window {
                    picture: size,
                    corner: [x, y],
                    size: tile,
                },
            )?;
            let drawn: Vec<[f32; 4]> = gpu.read_texture(&texture)?;
            // The last tiles of a row or column reach beyond the picture.
            let width = tile[0].min(size[0] - x) as usize;
            for (row, line) in drawn.chunks_exact(tile[0] as usize).enumerate() {
                let to = (y as usize + row) * size[0] as usize + x as usize;
                if let Some(to) = pixels.get_mut(to..to + width) {
                    to.copy_from_slice(&line[..width]);
                }
            }
        }
    }
    Ok(pixels)
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
