//! Light transport through the deformed body: progressive path tracing, a sample per pixel at a time.
//!
//! [`PathTracer`] holds the sums of a picture. Data that depend on the positions (planes of the tets,
//! maps to rest positions, the tree of boxes around the boundary) are computed by passes when it is
//! created, so that a bent body costs what one at rest costs. The medium is that of the raycaster:
//! extinction and colour by transfer function, region or scan; deformation leaves them unchanged.

mod boxes;
mod denoise;
mod environment;
mod lobes;
mod majorants;
mod options;
mod picture;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;
mod tone;
mod walls;

pub(crate) use environment::Environment;
pub(crate) use options::PathOptions;
use picture::PathPicture;
pub(crate) use tone::linear_light;
pub(crate) use walls::Wall;

use super::image_tiles::check_size;
use super::view::{CameraTransform, ImageRegion};
use super::{Camera, Image, Raycaster};
use crate::gpu::{Array, Gpu, Pass, Texel};
use crate::progress::ProgressFn;
use crate::{Error, Result};
use boxes::BoxTree;
use lobes::SpecularAlbedo;
use walls::Walls;

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path.wgsl`.
        pub(super) struct Path {
            pub right: [f32; 4],
            pub up: [f32; 4],
            pub forward: [f32; 4],
            pub slope: [f32; 4],
            pub base: [f32; 4],
            pub sky_x: [f32; 4],
            pub sky_y: [f32; 4],
            pub sky_z: [f32; 4],
            pub albedos: [[f32; 4]; 8],
            pub sky_size: [u32; 2],
            pub size: [u32; 2],
            pub corner: [u32; 2],
            pub sample: u32,
            pub seed: u32,
            pub extinction: f32,
            pub anisotropy: f32,
            pub alpha: f32,
            pub mean_albedo: f32,
            pub near: f32,
            pub focus: f32,
            pub lens: f32,
            pub faces: u32,
            pub leaves: u32,
            pub wall_count: u32,
            pub wall_leaves: u32,
            pub max_steps: u32,
        }
    }
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path_maps.wgsl`.
        pub(super) struct Maps {
            pub tets: u32,
        }
    }
}

/// Tile side in pixels, which bounds the duration of a submission and the size of a buffer.
const TILE: u32 = 512;
/// Items of four floats per pixel in the sums.
pub(super) const ITEMS: usize = 2;
/// Steps (tets entered and collisions) after which a path counts as lost.
const MAX_STEPS: u32 = 1 << 18;

/// A picture in progress.
pub(crate) struct PathTracer {
    gpu: Gpu,
    options: PathOptions,
    size: [u32; 2],
    tiles: Vec<Tile>,
    lost: wgpu::Buffer,
    /// Samples drawn of each pixel.
    samples: u32,
    /// Picture of the raycaster, by which the noise is filtered, if it is.
    guide: Option<Image>,
}

/// A part of the picture.
struct Tile {
    window: ImageRegion,
    params: gpu_data::Path,
    pass: Pass,
    sums: wgpu::Buffer,
}

impl Raycaster {
    /// Starts a picture of `size` pixels in the light of `options`, at the current positions, with the
    /// surfaces `walls` of skins and tools.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera, size or option, and for what paths do not show: slices,
    /// isosurfaces, and scans of a body without its volume; [`Error::Gpu`] if the device fails.
    pub(crate) fn start_paths(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        (options, walls): (&PathOptions, &[Wall]),
    ) -> Result<PathTracer> {
        camera.check()?;
        check_size(size)?;
        options.check(camera)?;
        self.check_path_content()?;
        self.looks.check(&self.geometry)?;
        let gpu = self.gpu.clone();
        let mut work = gpu.start_recording();
        self.geometry.record_refresh(&mut work)?;
        self.geometry.record_gradients(&mut work);
        let tree = BoxTree::new(&gpu, &self.geometry)?;
        tree.record(&mut work);
        let maps = self.record_rest_maps(&mut work)?;
        work.submit()?;
        let walls = Walls::new(&gpu, walls)?;
        let majorants = self.path_majorants()?;
        let (sky, sky_axes) = options.environment.to_gpu(&gpu, camera)?;
        let lost = gpu.buffer("lost paths", 4)?;
        let common = gpu_data::Path {
            sky_x: sky_axes[0],
            sky_y: sky_axes[1],
            sky_z: sky_axes[2],
            sky_size: sky.size,
            faces: tree.faces,
            leaves: tree.leaves,
            wall_count: walls.count,
            wall_leaves: walls.leaves,
            ..self.path_medium(options)
        };
        let arrays = PathArrays {
            majorants: &majorants,
            maps: &maps,
            sky: &sky.buffer,
            boxes: &tree.boxes,
            walls: &walls.buffer,
            lost: &lost,
        };
        let mut tiles = Vec::new();
        for y in (0..size[1]).step_by(TILE as usize) {
            for x in (0..size[0]).step_by(TILE as usize) {
                let window = ImageRegion {
                    picture: size,
                    corner: [x, y],
                    size: [TILE.min(size[0] - x), TILE.min(size[1] - y)],
                };
                tiles.push(self.path_tile((camera, window), options, &arrays, common)?);
            }
        }
        Ok(PathTracer {
            gpu,
            options: options.clone(),
            size,
            tiles,
            lost,
            samples: 0,
            guide: None,
        })
    }

    /// Returns the parameters of the medium; those of the rest are zero.
    fn path_medium(&self, options: &PathOptions) -> gpu_data::Path {
        let albedo = SpecularAlbedo::new(options.roughness);
        let scale = self.geometry.frame().scale;
        gpu_data::Path {
            albedos: albedo.to_gpu(),
            mean_albedo: albedo.mean() as f32,
            alpha: (options.roughness * options.roughness) as f32,
            anisotropy: options.anisotropy as f32,
            extinction: options.extinction as f32 * self.looks.table.opacity
                / std::f32::consts::LOG2_E,
            lens: (options.aperture / scale) as f32,
            seed: options.seed,
            max_steps: MAX_STEPS,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    fn path_tile(
        &self,
        (camera, window): (&Camera, ImageRegion),
        options: &PathOptions,
        arrays: &PathArrays,
        common: gpu_data::Path,
    ) -> Result<Tile> {
        let frame = self.geometry.frame();
        let view = CameraTransform::new(camera, &frame, window).to_gpu();
        let focus = options.focus_distance(camera) / frame.scale;
        let params = gpu_data::Path {
            right: view.right,
            up: view.up,
            forward: view.forward,
            slope: view.slope,
            base: view.base,
            near: view.near,
            focus: view.near + focus as f32,
            size: window.size,
            corner: window.corner,
            ..common
        };
        let pixels = u64::from(window.size[0]) * u64::from(window.size[1]);
        let sums = self
            .gpu
            .buffer("sums of paths", 16 * ITEMS as u64 * pixels)?;
        Ok(Tile {
            window,
            params,
            pass: self.path_pass(arrays, &sums, &params)?,
            sums,
        })
    }

    /// Rejects what paths do not show.
    fn check_path_content(&self) -> Result<()> {
        let inside = self.looks.inside();
        let what = if !inside.isosurfaces.is_empty() {
            "isosurfaces"
        } else if inside.planes.len() > inside.clips().count() {
            "slices"
        } else if !inside.draw_volume {
            "pictures without the volume"
        } else {
            return Ok(());
        };
        Err(Error::Input(format!(
            "light of paths does not show {what}; use another light (--light head), or leave them out"
        )))
    }

    /// Records the maps from the deformed body to rest positions; a placeholder if nothing needs them.
    fn record_rest_maps(&self, work: &mut crate::gpu::Recorder) -> Result<Array> {
        let (gpu, tets) = (&self.gpu, self.geometry.tet_count());
        let Some(rests) = self
            .geometry
            .rest_positions()
            .filter(|_| self.looks.needs_rest())
        else {
            return gpu.array("no maps to rest", Texel::F32x4, 1);
        };
        let maps = gpu.array("maps to rest", Texel::F32x4, 3 * tets as usize)?;
        let pass = gpu
            .pass("render/path_maps")
            .read(&self.geometry.positions)
            .read(rests)
            .read(&self.geometry.tets)
            .write(&maps)
            .params(&gpu_data::Maps { tets })
            .dispatch_items(tets)?;
        pass.record(work);
        Ok(maps)
    }

    fn path_pass(
        &self,
        arrays: &PathArrays,
        sums: &wgpu::Buffer,
        params: &gpu_data::Path,
    ) -> Result<Pass> {
        let (geometry, looks) = (&self.geometry, &self.looks);
        let flag = |on: bool| f64::from(u8::from(on));
        let scans = looks.scans();
        let reads = match self.options.reads.are_stored(&self.gpu) {
            true => "stored",
            false => "sampled",
        };
        let scan = if scans.is_some() { " scan" } else { "" };
        let name = format!("render/path {reads}{scan}");
        let records = geometry
            .records()
            .ok_or_else(|| Error::Gpu("the tet records of the paths are missing".into()))?;
        let gradients = geometry.gradients().filter(|_| scans.is_none());
        let [clips, ..] = looks.inside().counts();
        let mut builder = self
            .gpu
            .pass(&name)
            .read(records)
            .read(&geometry.tets)
            .read(&geometry.positions)
            .read(gradients.unwrap_or(&looks.sections))
            .read(&geometry.cells)
            .read(looks.rows().unwrap_or(&self.no_rows))
            .read(&looks.colours)
            .read(arrays.majorants)
            .read(&looks.sections)
            .read(arrays.maps);
        if let Some((held, places)) = scans {
            builder = builder
                .read(&held.texture)
                .read(&held.sampler)
                .read(places)
                .constant("SCAN_COUNT", held.scans.len() as f64)
                .constant("LABELS", flag(held.has_labels()));
        }
        builder
            .read(arrays.sky)
            .read(arrays.boxes)
            .read(&geometry.boundary)
            .read(arrays.walls)
            .write(sums)
            .write(arrays.lost)
            .params(params)
            .constant("CELL_SCALARS", flag(geometry.is_cell_scalar))
            .constant("HAS_REGIONS", flag(looks.rows().is_some()))
            .constant("HAS_SCANS", flag(scans.is_some()))
            .constant("SURFACES", flag(self.options.light.is_on()))
            .constant("NODE_GRADIENTS", flag(gradients.is_some()))
            .constant("USE_REST_POSITIONS", flag(looks.needs_rest()))
            .constant("CLIP_PLANE_COUNT", clips as f64)
            .constant("HAS_WALLS", flag(params.wall_count > 0))
            .dispatch_workgroups([params.size[0].div_ceil(8), params.size[1].div_ceil(8), 1])
    }
}

/// Arrays that the paths read and write besides those of the raycaster.
struct PathArrays<'a> {
    majorants: &'a Array,
    maps: &'a Array,
    sky: &'a wgpu::Buffer,
    boxes: &'a wgpu::Buffer,
    walls: &'a wgpu::Buffer,
    lost: &'a wgpu::Buffer,
}

impl PathTracer {
    /// Filters the noise of pictures by that of the raycaster from the same camera: `guide`, of the
    /// same size.
    ///
    /// # Errors
    /// [`Error::Input`] for another size.
    pub fn filter_by(&mut self, guide: Image) -> Result<()> {
        if guide.size != self.size || guide.channels != 4 {
            return Err(Error::Input(
                "the guide of the filter must have the size of the picture".into(),
            ));
        }
        self.guide = Some(guide);
        Ok(())
    }

    /// Adds a sample to each pixel. Reads nothing back.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails.
    pub fn add_sample(&mut self) -> Result<()> {
        for tile in &mut self.tiles {
            tile.params.sample = self.samples;
            let mut work = self.gpu.start_recording();
            tile.pass.set_params(&mut work, &tile.params)?;
            tile.pass.record(&mut work);
            work.submit()?;
        }
        self.samples += 1;
        Ok(())
    }

    /// Adds samples until their number or the noise of the options is reached.
    ///
    /// # Errors
    /// As [`PathTracer::add_sample`], and [`Error::Cancelled`].
    pub fn finish(&mut self, progress: ProgressFn) -> Result<PathPicture> {
        let most = self.options.samples;
        let mut next_look = 8;
        loop {
            let done = f64::from(self.samples) / f64::from(most);
            if progress("light paths", done).is_break() {
                return Err(Error::Cancelled);
            }
            self.add_sample()?;
            // A queue without bound would delay a cancellation.
            self.gpu.wait()?;
            if self.samples >= most {
                return self.picture();
            }
            // The noise is read back seldom: at powers of √2 or so of the samples.
            if let Some(noise) = self.options.noise
                && self.samples >= next_look
            {
                next_look = self.samples + self.samples / 2;
                let picture = self.picture()?;
                if picture.noise() <= noise {
                    return Ok(picture);
                }
            }
        }
    }

    /// Returns the picture of the samples so far. Waits for the device and reads back.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device fails.
    pub fn picture(&self) -> Result<PathPicture> {
        let columns = self.size[0] as usize;
        let mut sums = vec![[[0.0f32; 4]; ITEMS]; columns * self.size[1] as usize];
        for tile in &self.tiles {
            let part: Vec<[[f32; 4]; ITEMS]> = self.gpu.read_buffer(&tile.sums)?;
            let [width, _] = tile.window.size.map(|n| n as usize);
            let [x, y] = tile.window.corner.map(|n| n as usize);
            for (line, row) in part.chunks_exact(width).zip(y..) {
                sums[row * columns + x..][..width].copy_from_slice(line);
            }
        }
        let lost = self.gpu.read_buffer::<u32>(&self.lost)?;
        Ok(PathPicture::new(
            self.size,
            &sums,
            (self.samples, lost.first().copied().unwrap_or(0)),
            &self.options,
            self.guide.as_ref(),
        ))
    }
}
