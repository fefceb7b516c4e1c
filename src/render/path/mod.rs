//! Light transport through the deformed body: progressive path tracing, a sample per pixel at a time.
//!
//! [`PathTracer`] holds the sums of a picture. Data that depend on the positions (planes of the tets,
//! maps to rest positions, the tree of boxes around the boundary) are computed by passes when it is
//! created, so that a bent body costs what one at rest costs. The medium is that of the raycaster:
//! extinction and colour by transfer function, region or scan; deformation leaves them unchanged.

mod boxes;
#[cfg(test)]
mod closed_forms;
mod denoise;
mod environment;
mod lobes;
mod majorants;
mod options;
mod picture;
mod progressive;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod reference_scan;
#[cfg(test)]
mod reference_sections;
mod sampling;
#[cfg(test)]
mod section_tests;
#[cfg(test)]
mod sweep_tests;
#[cfg(test)]
mod tests;
mod tone;
mod walls;

pub(crate) use environment::Environment;
pub(crate) use options::PathOptions;
pub use progressive::ProgressivePaths;
use progressive::WINDOW_TILE;
pub(crate) use tone::linear_light;
pub(crate) use walls::Wall;

use super::image_tiles::check_size;
use super::view::{CameraTransform, ImageRegion};
use super::{Camera, Image, Raycaster};
use crate::gpu::{Array, Gpu, MOST_STORAGE_TEXTURES, Pass, Texel};
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
            pub until: u32,
            pub seed: u32,
            pub extinction: f32,
            pub anisotropy: f32,
            pub alpha: f32,
            pub mean_albedo: f32,
            pub near: f32,
            pub focus: f32,
            pub lens: f32,
            pub leaves: u32,
            pub wall_count: u32,
            pub wall_leaves: u32,
            pub max_steps: u32,
            pub max_work: u32,
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
/// Steps after which an invocation starts no other sample in a dispatch. The software driver ends
/// loops of eight invocations in lockstep after 65,535 turns in all.
const MAX_WORK: u32 = 1 << 12;
/// A picture in progress.
pub(crate) struct PathTracer {
    gpu: Gpu,
    options: PathOptions,
    size: [u32; 2],
    tiles: Vec<Tile>,
    counts: wgpu::Buffer,
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
    /// [`Error::Input`] for an invalid camera, size or option; [`Error::Gpu`] if the device fails.
    pub(crate) fn start_paths(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        with: (&PathOptions, &[Wall]),
    ) -> Result<PathTracer> {
        self.start_tiled_paths(camera, (size, TILE), with)
    }

    /// As [`Raycaster::start_paths`], for a picture that sets in over the frames of a window, over
    /// `backdrop`.
    pub(crate) fn start_progressive_paths(
        &mut self,
        camera: &Camera,
        (size, backdrop): ([u32; 2], [f32; 4]),
        with: (&PathOptions, &[Wall]),
    ) -> Result<ProgressivePaths> {
        let tracer = self.start_tiled_paths(camera, (size, WINDOW_TILE), with)?;
        ProgressivePaths::new(tracer, backdrop)
    }

    fn start_tiled_paths(
        &mut self,
        camera: &Camera,
        (size, tile): ([u32; 2], u32),
        (options, walls): (&PathOptions, &[Wall]),
    ) -> Result<PathTracer> {
        camera.check()?;
        check_size(size)?;
        options.check(camera)?;
        self.looks.check(&self.geometry)?;
        let gpu = self.gpu.clone();
        let mut work = gpu.start_recording();
        self.geometry.record_refresh(&mut work)?;
        self.geometry.record_gradients(&mut work);
        let tree = BoxTree::new(&gpu, &self.geometry)?;
        tree.record(&mut work);
        let rests = self
            .geometry
            .rest_positions()
            .filter(|_| self.looks.needs_rest());
        let maps = self.record_maps(&mut work, rests)?;
        let node_gradients = self.node_gradients();
        let gradients = self.record_maps(&mut work, node_gradients)?;
        work.submit()?;
        let walls = Walls::new(&gpu, walls)?;
        let majorants = self.path_majorants()?;
        let (sky, sky_axes) = options.environment.to_gpu(&gpu, camera)?;
        let sections = self.path_sections()?;
        let counts = gpu.buffer("counts of paths", 8)?;
        let common = gpu_data::Path {
            sky_x: sky_axes[0],
            sky_y: sky_axes[1],
            sky_z: sky_axes[2],
            sky_size: sky.size,
            leaves: tree.leaves,
            wall_count: walls.count,
            wall_leaves: walls.leaves,
            ..self.path_medium(options)
        };
        let arrays = PathArrays {
            majorants: &majorants,
            maps: &maps,
            gradients: &gradients,
            sky: &sky.items,
            boxes: &tree.boxes,
            faces: &tree.faces,
            walls: &walls.items,
            sections: &sections,
            counts: &counts,
        };
        let mut tiles = Vec::new();
        for y in (0..size[1]).step_by(tile as usize) {
            for x in (0..size[0]).step_by(tile as usize) {
                let window = ImageRegion {
                    picture: size,
                    corner: [x, y],
                    size: [tile.min(size[0] - x), tile.min(size[1] - y)],
                };
                tiles.push(self.path_tile((camera, window), options, &arrays, common)?);
            }
        }
        Ok(PathTracer {
            gpu,
            options: options.clone(),
            size,
            tiles,
            counts,
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
            max_work: MAX_WORK,
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

    /// Returns planes and isosurfaces in the layout of `lib/sections.wgsl`, isosurfaces with the share
    /// of the range instead of the table coordinate.
    fn path_sections(&self) -> Result<Array> {
        let (low, high) = self.looks.range();
        let share = |s: f64| (s - low) / (high - low);
        let inside = self.looks.inside();
        inside.to_gpu(&self.gpu, self.geometry.frame(), share)
    }

    /// Returns the gradient at each node, if surfaces have their normals from it.
    fn node_gradients(&self) -> Option<&Array> {
        let no_scan = self.looks.scans().is_none();
        self.geometry.gradients().filter(|_| no_scan)
    }

    /// Records the maps from places in the deformed body to the vectors of the nodes; a placeholder
    /// without these.
    fn record_maps(
        &self,
        work: &mut crate::gpu::Recorder,
        vectors: Option<&Array>,
    ) -> Result<Array> {
        let (gpu, tets) = (&self.gpu, self.geometry.tet_count());
        let Some(vectors) = vectors else {
            return gpu.array("no maps", Texel::F32x4, 1);
        };
        let maps = gpu.array("maps of tets", Texel::F32x4, 3 * tets as usize)?;
        let pass = gpu
            .pass("render/path_maps")
            .read(&self.geometry.positions)
            .read(vectors)
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
        let limits = self.gpu.device().limits();
        let fits = limits.max_storage_textures_per_shader_stage >= MOST_STORAGE_TEXTURES;
        let reads = match fits && self.options.reads.are_stored(&self.gpu) {
            true => "stored",
            false => "sampled",
        };
        let scan = if scans.is_some() { " scan" } else { "" };
        let name = format!("render/path {reads}{scan}");
        let records = geometry
            .records()
            .ok_or_else(|| Error::Gpu("the tet records of the paths are missing".into()))?;
        let [clips, slices, isosurfaces] = looks.inside().counts();
        let mut builder = self
            .gpu
            .pass(&name)
            .read(records)
            .read(arrays.boxes)
            .read(arrays.faces)
            .read(arrays.majorants)
            .read(&looks.colours)
            .read(arrays.gradients)
            .read(arrays.sky)
            .read(arrays.walls)
            .read(&geometry.cells)
            .read(looks.rows().unwrap_or(&self.no_rows))
            .read(arrays.sections)
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
            .write(sums)
            .write(arrays.counts)
            .params(params)
            .constant("CELL_SCALARS", flag(geometry.is_cell_scalar))
            .constant("HAS_REGIONS", flag(looks.rows().is_some()))
            .constant("HAS_SCANS", flag(scans.is_some()))
            .constant("SURFACES", flag(self.options.light.is_on()))
            .constant("NODE_GRADIENTS", flag(self.node_gradients().is_some()))
            .constant("USE_REST_POSITIONS", flag(looks.needs_rest()))
            .constant("CLIP_PLANE_COUNT", clips as f64)
            .constant("SLICE_COUNT", slices as f64)
            .constant("ISOSURFACE_COUNT", isosurfaces as f64)
            .constant("DRAW_VOLUME", flag(looks.inside().draw_volume))
            .constant("HAS_WALLS", flag(params.wall_count > 0))
            .dispatch_workgroups([params.size[0].div_ceil(8), params.size[1].div_ceil(8), 1])
    }
}

/// Arrays that the paths read and write besides those of the raycaster.
struct PathArrays<'a> {
    majorants: &'a Array,
    maps: &'a Array,
    gradients: &'a Array,
    sky: &'a Array,
    boxes: &'a Array,
    faces: &'a Array,
    walls: &'a Array,
    sections: &'a Array,
    counts: &'a wgpu::Buffer,
}
