//! Extraction of the individual ray segments through a mesh, used to composite the pieces of a
//! partitioned body.

use super::Raycaster;
use crate::gpu::Gpu;
use crate::render::image_tiles::check_size;
use crate::render::raycast_options::{Integrand, Target};
use crate::render::view::ImageRegion;
use crate::render::{Camera, RaySegment, RaySegments};
use crate::{Error, Result};

/// Tile sides in pixels, tried from the largest until the segments of a tile fit into the device
/// buffer.
const TILE_SIZES: [u32; 3] = [512, 128, 32];
/// Initial buffer capacity, in segments per pixel.
const INITIAL_CAPACITY: u64 = 2;
/// Size of a segment in the device buffer and of the header before the first segment, in bytes.
const SEGMENT_BYTES: u64 = 32;
const HEADER_BYTES: u64 = 16;
/// Maximum number of layers of a raycaster.
const MAX_LAYERS: u32 = 255;

impl Raycaster {
    /// Returns the segments of the rays of `camera` through this mesh, a piece of a body: for each
    /// pixel of an image of `size` pixels, one separate segment per traversal of the mesh, to be
    /// composited with the segments of the other pieces ([`RaySegments::merged`]). Peels as many
    /// layers as needed, up to 255, regardless of the options. Waits for the GPU and reads back.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera or size, for shadows (a piece has no data of the
    /// other pieces), for planes, isosurfaces or scans (not supported by segments), and for a ray
    /// that enters the mesh more than 255 times; [`Error::Gpu`] if the device fails.
    pub fn intervals(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaySegments> {
        self.check_pieces()?;
        check_size(size)?;
        let asked = self.options.layers;
        let drawn = self.draw_intervals(camera, size);
        if self.options.layers != asked {
            self.options.layers = asked;
            self.frames.clear();
        }
        self.segment_buffer = None;
        self.forget_walks();
        drawn
    }

    /// Rejects settings that images of pieces do not support.
    fn check_pieces(&self) -> Result<()> {
        let inside = self.looks.inside();
        let what = if self.options.shadows > 0.0 {
            "shadows, which depend on other pieces"
        } else if !(inside.planes.is_empty() && inside.isosurfaces.is_empty() && inside.draw_volume)
        {
            "planes and isosurfaces"
        } else if self.looks.scans().is_some() {
            "scans"
        } else {
            return Ok(());
        };
        Err(Error::Input(format!(
            "images of pieces do not support {what}; omit them, or render the whole body"
        )))
    }

    fn draw_intervals(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaySegments> {
        for side in TILE_SIZES {
            let tile = size.map(|n| n.min(side));
            let mut items = Vec::new();
            let gpu = self.gpu.clone();
            let target = gpu.target(
                "picture",
                tile,
                wgpu::TextureFormat::Rgba32Float,
                wgpu::TextureUsages::RENDER_ATTACHMENT,
            )?;
            let corners = (0..size[1])
                .step_by(tile[1] as usize)
                .flat_map(|y| (0..size[0]).step_by(tile[0] as usize).map(move |x| [x, y]));
            let mut fits = true;
            for corner in corners {
                let window = ImageRegion {
                    picture: size,
                    corner,
                    size: tile,
                };
                fits = self.draw_window(camera, window, &target, &mut items)?;
                if !fits {
                    break;
                }
            }
            if fits {
                return RaySegments::new(size, items);
            }
        }
        Err(Error::Gpu(
            "the ray segments of the piece exceed the buffer size limit of the device; partition the body into more pieces".into(),
        ))
    }

    /// Appends the segments in `window`; returns false if the device buffer cannot hold them.
    fn draw_window(
        &mut self,
        camera: &Camera,
        window: ImageRegion,
        target: &wgpu::TextureView,
        items: &mut Vec<RaySegment>,
    ) -> Result<bool> {
        let gpu = self.gpu.clone();
        let [width, height] = window.size.map(u64::from);
        loop {
            let segment_buffer = match &self.segment_buffer {
                Some(segment_buffer) => segment_buffer.clone(),
                None => self.allocate_segments(&gpu, INITIAL_CAPACITY * width * height)?,
            };
            let mut work = gpu.start_recording();
            work.encoder()
                .clear_buffer(&segment_buffer, 0, Some(HEADER_BYTES));
            let target = Target {
                colour: target,
                depth: None,
                background: Some([0.0; 4]),
            };
            self.record_window(&mut work, camera, Integrand::Intervals, &target, window)?;
            work.submit()?;
            let layers = self.layers_found()?;
            if layers > self.options.layers {
                if self.options.layers >= MAX_LAYERS {
                    return Err(Error::Input(format!(
                        "a ray enters the piece more than {MAX_LAYERS} times; partition the body into more pieces, or move the eye slightly"
                    )));
                }
                self.options.layers = (2 * self.options.layers).min(MAX_LAYERS);
                self.frames.clear();
                continue;
            }
            let head = gpu.read_prefix::<u32>(&segment_buffer, HEADER_BYTES)?;
            let count = u64::from(head.first().copied().unwrap_or(0));
            if HEADER_BYTES + SEGMENT_BYTES * count > segment_buffer.size() {
                let limits = gpu.device().limits();
                let most = limits
                    .max_buffer_size
                    .min(limits.max_storage_buffer_binding_size);
                if HEADER_BYTES + SEGMENT_BYTES * count > most {
                    return Ok(false);
                }
                let room = (2 * count).min((most - HEADER_BYTES) / SEGMENT_BYTES);
                self.allocate_segments(&gpu, room)?;
                continue;
            }
            let words =
                gpu.read_prefix::<[u32; 4]>(&segment_buffer, HEADER_BYTES + SEGMENT_BYTES * count)?;
            let (segments, _) = words.get(1..).unwrap_or_default().as_chunks::<2>();
            let inside = segments
                .iter()
                .filter_map(|segment| window.interval(segment));
            items.extend(inside);
            return Ok(true);
        }
    }

    /// Allocates the buffer for `capacity` segments.
    fn allocate_segments(&mut self, gpu: &Gpu, capacity: u64) -> Result<wgpu::Buffer> {
        let segment_buffer = gpu.buffer("ray segments", HEADER_BYTES + SEGMENT_BYTES * capacity)?;
        self.forget_walks();
        Ok(self.segment_buffer.insert(segment_buffer).clone())
    }
}

impl ImageRegion {
    /// Decodes a segment written by `terms/intervals.wgsl`; returns `None` for a pixel outside the
    /// image, which occurs in tiles at its edges.
    fn interval(&self, [place, seen]: &[[u32; 4]; 2]) -> Option<RaySegment> {
        let [pixel, front, back, _] = *place;
        let x = self.corner[0] + (pixel & 0xffff);
        let y = self.corner[1] + (pixel >> 16);
        let [width, height] = self.picture;
        (x < width && y < height).then(|| RaySegment {
            pixel: x + width * y,
            depths: [front, back].map(f32::from_bits),
            rgba: seen.map(f32::from_bits),
        })
    }
}
