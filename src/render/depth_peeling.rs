//! Depth peeling: finds and traverses the layers of a mesh that a ray enters more than once, front
//! to back, without GPU readback.
//!
//! All layers are recorded, up to a limit. The draws of layer k run only if layer k − 1 found a
//! face: its fragments set the instance counts in the indirect arguments of the following draws.
//! Layers of even and odd index alternate between two argument buffers and two of each target, so
//! that no pass reads its own output.

use super::geometry::Geometry;
use super::view::View;
use crate::Result;
use crate::gpu::{Array, BitmaskPrefixSum, Draw, Gpu, Pass, Recorder, Texel};

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/visible_face_counts.wgsl`.
        pub struct CoverCounts {
            pub records: u32,
        }
    }
}

/// Words of the argument record of a layer: a boundary draw for the next layer, and a draw of its
/// own traversal, fullscreen or by tiles.
const RECORD_WORDS: usize = 8;
/// Tile side in pixels; `lib/tiles.wgsl` has the same value.
const TILE: u32 = 16;
const KEY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Format of the accumulated ray values.
pub(super) const SUM: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Number of image sizes whose targets are kept: interactive rendering alternates between a coarse
/// size in motion and a fine size at rest.
pub(crate) const CACHED_SIZES: usize = 2;

/// Targets of one size, and the draws that find the layers.
pub(super) struct Peel {
    /// Target size in pixels.
    pub size: [u32; 2],
    /// Ray starts of even and odd layers: depth bits and 4 tet + face.
    pub keys: [wgpu::TextureView; 2],
    /// Nearest back faces.
    pub back_faces: wgpu::TextureView,
    /// Accumulated ray values up to even and odd layers.
    pub accumulators: [wgpu::TextureView; 2],
    /// Indirect arguments of even and odd layers.
    arguments: [wgpu::Buffer; 2],
    /// Last even and last odd layer with a face in each tile; 0 if none beyond the first.
    pub last_layers: [wgpu::Buffer; 2],
    depth: wgpu::TextureView,
    fresh_arguments: [wgpu::Buffer; 2],
    inside: wgpu::Buffer,
    /// Initial flags for an image and for a report; a report tests every ray for an eye inside the
    /// mesh.
    fresh_inside: [wgpu::Buffer; 2],
    /// Maximum number of layers.
    pub layers: u32,
    /// Indirect draw of the potentially visible faces.
    covered: wgpu::Buffer,
    project: Pass,
    /// Passes that find these faces.
    cover: [Pass; 4],
    start_back: Draw,
    start_first: Draw,
    start_next: [Draw; 2],
    clear: [Draw; 2],
}

/// Traversal draws from the starts of a layer, for one mode.
pub(super) struct TraversalDraws {
    /// From back faces to an eye inside the mesh.
    pub back: Draw,
    /// Even and odd layers.
    pub layers: [Draw; 2],
}

impl Peel {
    /// Creates targets of `size` pixels for at most `layers` layers. The boundary is read from
    /// storage textures if `stored`.
    pub fn new(
        geometry: &Geometry,
        view: &View,
        size: [u32; 2],
        layers: u32,
        stored: bool,
    ) -> Result<Peel> {
        let gpu = &geometry.gpu;
        let corners = geometry.corners();
        let attached = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let bound = attached | wgpu::TextureUsages::TEXTURE_BINDING;
        let texture = |format, usage| gpu.target("peel target", size, format, usage);
        let keys = [texture(KEY_FORMAT, bound)?, texture(KEY_FORMAT, bound)?];
        let sums = [texture(SUM, bound)?, texture(SUM, bound)?];
        let tiles = size[0].div_ceil(TILE) * size[1].div_ceil(TILE);
        let last = |name| gpu.buffer(name, 4 * u64::from(tiles.max(1)));
        let last_layers = [last("last even layers")?, last("last odd layers")?];
        let [arguments, fresh_arguments] = argument_buffers(gpu, corners, tiles, layers)?;
        let outside = [corners, 0, 0, 0, 3, 0, 0, 0];
        let inside = gpu.buffer_of("inside", &outside)?;
        let fresh_inside = [
            gpu.buffer_of("inside, fresh", &outside)?,
            gpu.buffer_of("inside, always", &[corners, 1, 0, 0, 3, 1, 0, 0])?,
        ];
        let covered = gpu.buffer_of("covered faces draw", &[0u32, 1, 0, 0])?;
        let covers = gpu.array("covered faces", Texel::U32x4, corners as usize)?;
        let reads = if stored { "stored" } else { "sampled" };
        let start_name = format!("render/start {reads}");
        let start = |first: bool, back: bool, writes: usize| {
            gpu.draw(&start_name)
                .constant("FIRST_LAYER", f64::from(u8::from(first)))
                .constant("BACK_FACES", f64::from(u8::from(back)))
                .read(&geometry.projected)
                .read(&geometry.boundary)
                .read(&covers)
                .read(&keys[1 - writes])
                .read(&sums[1 - writes])
                .write(&arguments[writes])
                .write(&last_layers[writes])
                .params(view)
                .target(KEY_FORMAT, None)
                .depth(DEPTH, wgpu::CompareFunction::Greater, true)
                .build()
        };
        let clear = |writes: usize| {
            gpu.draw("render/clear")
                .read(&keys[1 - writes])
                .read(&last_layers[1 - writes])
                .target(KEY_FORMAT, None)
                .depth(DEPTH, wgpu::CompareFunction::Always, true)
                .build()
        };
        Ok(Peel {
            size,
            back_faces: texture(KEY_FORMAT, bound)?,
            depth: texture(DEPTH, attached)?,
            project: gpu
                .pass("render/project")
                .read(&geometry.positions)
                .read(&geometry.scalars)
                .write(&geometry.projected)
                .write(&inside)
                .params(view)
                .dispatch_items(view.nodes)?,
            cover: cover_passes(geometry, view, &covers, &covered, (&arguments, layers))?,
            start_back: start(true, true, 0)?,
            start_first: start(true, false, 0)?,
            start_next: [start(false, false, 0)?, start(false, false, 1)?],
            clear: [clear(0)?, clear(1)?],
            keys,
            accumulators: sums,
            arguments,
            fresh_arguments,
            last_layers,
            covered,
            inside,
            fresh_inside,
            layers,
        })
    }

    /// Records the peeling and traversal of all layers, from node projection to the final sum. For
    /// a `report`, every ray is treated as possibly starting at an eye inside the mesh.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) if the view does not fit the device.
    pub fn record(
        &self,
        work: &mut Recorder,
        walks: &TraversalDraws,
        view: &View,
        report: bool,
    ) -> Result<()> {
        self.prepare(work, walks, view, report)?;
        self.project.record(work);
        self.cover.iter().for_each(|pass| pass.record(work));
        {
            let depth = self.depth_attachment(true);
            let mut pass = work.render_pass(
                "render/start",
                &[cleared(&self.back_faces, CLEAR_KEY)],
                depth,
            );
            self.start_back.record_indirect(&mut pass, &self.inside, 0);
        }
        {
            let depth = self.depth_attachment(true);
            let mut pass =
                work.render_pass("render/start", &[cleared(&self.keys[0], CLEAR_KEY)], depth);
            self.start_first
                .record_indirect(&mut pass, &self.covered, 0);
        }
        {
            let zero = cleared(&self.accumulators[1], wgpu::Color::TRANSPARENT);
            let mut pass = work.render_pass("render/walk", &[zero], None);
            walks
                .back
                .record_indirect(&mut pass, &self.inside, WALK_ARGUMENTS);
        }
        {
            let zero = cleared(&self.accumulators[0], wgpu::Color::TRANSPARENT);
            let mut pass = work.render_pass("render/walk", &[zero], None);
            walks.layers[0].record(&mut pass, 3, 1);
        }
        // One layer beyond the limit detects whether layers remain.
        for layer in 1..=self.layers {
            let (parity, before) = (layer as usize % 2, 1 - layer as usize % 2);
            {
                let depth = self.depth_attachment(false);
                let mut pass = work.render_pass("render/start", &[kept(&self.keys[parity])], depth);
                let arguments = &self.arguments[before];
                let offset = record_offset(layer - 1);
                self.clear[parity].record_indirect(&mut pass, arguments, offset + WALK_ARGUMENTS);
                self.start_next[parity].record_indirect(&mut pass, arguments, offset);
            }
            if layer < self.layers {
                let mut pass =
                    work.render_pass("render/walk", &[kept(&self.accumulators[parity])], None);
                let offset = record_offset(layer) + WALK_ARGUMENTS;
                walks.layers[parity].record_indirect(&mut pass, &self.arguments[parity], offset);
            }
        }
        Ok(())
    }

    /// Sets the parameters, and resets the arguments and counts of the layers.
    fn prepare(
        &self,
        work: &mut Recorder,
        walks: &TraversalDraws,
        view: &View,
        report: bool,
    ) -> Result<()> {
        self.project.set_params(work, view)?;
        for stage in [0, 2] {
            self.cover[stage].set_params(work, view)?;
        }
        for draw in [&self.start_back, &self.start_first]
            .into_iter()
            .chain(&self.start_next)
            .chain([&walks.back])
            .chain(&walks.layers)
        {
            draw.set_params(work, view)?;
        }
        let copies = [
            (&self.fresh_arguments[0], &self.arguments[0]),
            (&self.fresh_arguments[1], &self.arguments[1]),
            (&self.fresh_inside[usize::from(report)], &self.inside),
        ];
        for (fresh, used) in copies {
            work.encoder()
                .copy_buffer_to_buffer(fresh, 0, used, 0, fresh.size());
        }
        for last in &self.last_layers {
            work.encoder().clear_buffer(last, 0, None);
        }
        Ok(())
    }

    /// Returns the number of layers with a face in the last image; limit + 1 if layers remain.
    /// Reads back.
    ///
    /// # Errors
    /// As [`Gpu::read_buffer`].
    pub fn layer_count(&self, gpu: &Gpu) -> Result<u32> {
        let records = [
            gpu.read_buffer::<u32>(&self.arguments[0])?,
            gpu.read_buffer::<u32>(&self.arguments[1])?,
        ];
        let ran = |layer: &u32| {
            let word = (record_offset(*layer) / 4) as usize + 1;
            records[*layer as usize % 2]
                .get(word)
                .is_some_and(|n| *n > 0)
        };
        Ok((0..=self.layers).take_while(ran).count() as u32)
    }

    fn depth_attachment(&self, clear: bool) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
        Some(wgpu::RenderPassDepthStencilAttachment {
            view: &self.depth,
            depth_ops: Some(wgpu::Operations {
                // Reversed depth: 0 is farthest.
                load: if clear {
                    wgpu::LoadOp::Clear(0.0)
                } else {
                    wgpu::LoadOp::Load
                },
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        })
    }
}

/// Byte offset of the traversal arguments in a record.
const WALK_ARGUMENTS: u64 = 16;

/// Key of an empty pixel: depth 0, face `NONE`.
const CLEAR_KEY: wgpu::Color = wgpu::Color {
    r: 0.0,
    g: u32::MAX as f64,
    b: 0.0,
    a: 0.0,
};

/// Returns the byte offset of the record of a layer in the buffer of its parity.
fn record_offset(layer: u32) -> u64 {
    u64::from(layer / 2) * (RECORD_WORDS as u64) * 4
}

/// Creates the passes that find the potentially visible faces, and set how often they are drawn by
/// `covered` and by the arguments of the layers.
fn cover_passes(
    geometry: &Geometry,
    view: &View,
    covers: &Array,
    covered: &wgpu::Buffer,
    (arguments, layers): (&[wgpu::Buffer; 2], u32),
) -> Result<[Pass; 4]> {
    let gpu = &geometry.gpu;
    let runs = (geometry.corners() / 3).div_ceil(32);
    let marks = gpu.buffer("face visibility", 8 * u64::from(runs.max(1)))?;
    let cover = |stage: f64| {
        gpu.pass("render/visible_faces")
            .constant("PASS", stage)
            .read(&geometry.projected)
            .read(&geometry.boundary)
            .write(&marks)
            .write(covers)
            .params(view)
            .dispatch_items(runs)
    };
    // Number of records per buffer: each holds the layers of one parity.
    let records = layers / 2 + 1;
    Ok([
        cover(0.0)?,
        gpu.pass("gpu/bitmask_prefix_sum")
            .write(&marks)
            .write(covered)
            .params(&BitmaskPrefixSum { runs })
            .dispatch_workgroups([1, 1, 1])?,
        cover(1.0)?,
        gpu.pass("render/visible_face_counts")
            .read(covered)
            .write(&arguments[0])
            .write(&arguments[1])
            .params(&gpu_data::CoverCounts { records })
            .dispatch_items(records)?,
    ])
}

/// Creates the arguments of even and odd layers: those of a frame, and those that it starts from.
fn argument_buffers(
    gpu: &Gpu,
    corners: u32,
    tiles: u32,
    layers: u32,
) -> Result<[[wgpu::Buffer; 2]; 2]> {
    let [even, odd] = argument_records(corners, tiles, layers);
    Ok([
        [
            gpu.buffer_of("even layers", &even)?,
            gpu.buffer_of("odd layers", &odd)?,
        ],
        [
            gpu.buffer_of("even layers, fresh", &even)?,
            gpu.buffer_of("odd layers, fresh", &odd)?,
        ],
    ])
}

/// Returns the initial arguments of a frame for even and odd layers: only layer 0 runs.
fn argument_records(corners: u32, tiles: u32, layers: u32) -> [Vec<u32>; 2] {
    let mut records = [Vec::new(), Vec::new()];
    for layer in 0..=layers {
        let runs = u32::from(layer == 0);
        // The first vertex encodes the index of the next layer; see start.wgsl.
        let first = (layer + 1).saturating_mul(corners);
        // The first vertex of the traversal encodes its own layer; see lib/tiles.wgsl.
        let [walked, from] = match layer {
            0 => [3, 0],
            _ => [6 * tiles, (6 * tiles).saturating_mul(layer)],
        };
        let record = [corners, runs, first, 0, walked, runs, from, 0];
        records[layer as usize % 2].extend(record);
    }
    records
}

fn cleared(
    view: &wgpu::TextureView,
    colour: wgpu::Color,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    attachment(view, wgpu::LoadOp::Clear(colour))
}

fn kept(view: &wgpu::TextureView) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    attachment(view, wgpu::LoadOp::Load)
}

/// Returns a colour attachment with a store operation.
pub(crate) fn attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        resolve_target: None,
        ops: wgpu::Operations {
            load,
            store: wgpu::StoreOp::Store,
        },
        depth_slice: None,
    })
}
