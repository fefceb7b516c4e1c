//! The ways of rays through a mesh, each told by itself: of a piece of a body.

use super::Raycaster;
use crate::gpu::Gpu;
use crate::render::image_tiles::check_size;
use crate::render::raycast_options::{Integrand, Target};
use crate::render::view::ImageRegion;
use crate::render::{Camera, RaySegment, RaySegments};
use crate::{Error, Result};

/// Sides of the parts in which pictures are drawn: of as large ones as there is room for their ways.
const TILE_SIZES: [u32; 3] = [512, 128, 32];
/// Ways a pixel for which there is room at first.
const INITIAL_CAPACITY: u64 = 2;
/// Bytes of a way on the device, and of what stands before the first.
const SEGMENT_BYTES: u64 = 32;
const HEADER_BYTES: u64 = 16;
/// Most layers that a raycaster takes.
const MOST_LAYERS: u32 = 255;

impl Raycaster {
    /// What the rays of `camera` pass in this mesh, a piece of a body: for each pixel of a picture of
    /// `size` pixels its ways through the mesh, each by itself, to be composited with those of the
    /// other pieces ([`Intervals::merged`]). As many layers are peeled as there are, up to 255,
    /// whatever the options say. Waits and reads back.
    ///
    /// # Errors
    /// [`Error::Input`] for a bad camera or size, for what a piece cannot know by itself (shadows), what
    /// is not told by ways (planes, isosurfaces, scans), and for a ray that enters more than 255
    /// times; [`Error::Gpu`] when the device refuses.
    pub fn intervals(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaySegments> {
        self.check_pieces()?;
        check_size(size)?;
        let asked = self.options.layers;
        let drawn = self.draw_intervals(camera, size);
        if self.options.layers != asked {
            self.options.layers = asked;
            self.frames.clear();
        }
        self.told = None;
        self.forget_walks();
        drawn
    }

    /// Refuses what pictures of pieces cannot have.
    fn check_pieces(&self) -> Result<()> {
        let inside = self.looks.inside();
        let what = if self.options.shadows > 0.0 {
            "shadows, which other pieces cast"
        } else if !(inside.planes.is_empty() && inside.isosurfaces.is_empty() && inside.draw_volume)
        {
            "planes and isosurfaces"
        } else if self.looks.scans().is_some() {
            "scans"
        } else {
            return Ok(());
        };
        Err(Error::Input(format!(
            "a body in pieces is drawn without {what}; leave them out, or draw the whole"
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
            "rays enter the piece so often that the device has no room for all of their ways; cut the body into more pieces".into(),
        ))
    }

    /// Adds the ways in `window`; false where the device has no room for them.
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
            let told = match &self.told {
                Some(told) => told.clone(),
                None => self.make_room(&gpu, INITIAL_CAPACITY * width * height)?,
            };
            let mut work = gpu.start_recording();
            work.encoder().clear_buffer(&told, 0, Some(HEADER_BYTES));
            let target = Target {
                colour: target,
                depth: None,
                background: Some([0.0; 4]),
            };
            self.record_window(&mut work, camera, Integrand::Intervals, &target, window)?;
            work.submit()?;
            let layers = self.layers_found()?;
            if layers > self.options.layers {
                if self.options.layers >= MOST_LAYERS {
                    return Err(Error::Input(format!(
                        "a ray enters the piece more than {MOST_LAYERS} times; cut the body into more pieces, or move the eye a little"
                    )));
                }
                self.options.layers = (2 * self.options.layers).min(MOST_LAYERS);
                self.frames.clear();
                continue;
            }
            let head = gpu.read_prefix::<u32>(&told, HEADER_BYTES)?;
            let count = u64::from(head.first().copied().unwrap_or(0));
            if HEADER_BYTES + SEGMENT_BYTES * count > told.size() {
                let limits = gpu.device().limits();
                let most = limits
                    .max_buffer_size
                    .min(limits.max_storage_buffer_binding_size);
                if HEADER_BYTES + SEGMENT_BYTES * count > most {
                    return Ok(false);
                }
                let room = (2 * count).min((most - HEADER_BYTES) / SEGMENT_BYTES);
                self.make_room(&gpu, room)?;
                continue;
            }
            let words = gpu.read_prefix::<[u32; 4]>(&told, HEADER_BYTES + SEGMENT_BYTES * count)?;
            let (ways, _) = words.get(1..).unwrap_or_default().as_chunks::<2>();
            let inside = ways.iter().filter_map(|way| window.interval(way));
            items.extend(inside);
            return Ok(true);
        }
    }

    /// Has room for so many ways in a window.
    fn make_room(&mut self, gpu: &Gpu, ways: u64) -> Result<wgpu::Buffer> {
        let told = gpu.buffer("ways of rays", HEADER_BYTES + SEGMENT_BYTES * ways)?;
        self.forget_walks();
        Ok(self.told.insert(told).clone())
    }
}

impl ImageRegion {
    /// A way as `terms/intervals.wgsl` tells it; none for one beyond the picture, as windows at its
    /// edges reach.
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
