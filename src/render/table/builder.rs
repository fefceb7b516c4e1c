//! Sampled lookup tables built on the GPU: slices, the pre-integration volume of the paper, and the
//! transfer function itself.

use super::linear_pieces::{LinearPieces, gpu_data::Piece};
use super::{Table, TableKind, TableRequest, TableTexel};
use crate::Result;
use crate::gpu::{Gpu, Pass};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Limit {
            pub size: u32,
            pub pieces: u32,
        }
    }
    crate::gpu_struct! {
        pub(super) struct Slice {
            pub size: u32,
            pub half_depth: f32,
        }
    }
    crate::gpu_struct! {
        pub(super) struct VolumeLayer {
            pub size: u32,
            pub layer: u32,
            pub depth: f32,
        }
    }
}

/// Base-2 logarithm of the number of slices per octave of depth; `terms/slices.wgsl` has the same
/// numbers.
const OCTAVE_BITS: u32 = 2;
/// Exponent of the smallest depth: the first octave begins at 2 to this power.
const FIRST_OCTAVE: i32 = -5;
/// Maximum number of octaves: WebGPU's 256 layers hold 64, and depths beyond 2¹⁹ are opaque.
const MAX_OCTAVES: u32 = 24;
/// Maximum segment length covered by the slices, in local units; longer than any body.
const MAX_SEGMENT_LENGTH: f64 = 4.0;
/// Texels along the scalar without pre-integration.
const SAMPLED_SIZE: u32 = 4096;
/// WebGPU limit on the number of texture layers.
const MAX_LAYERS: u32 = 256;
/// Number of layers of the volume and maximum depth of the last: one layer per sixteenth of depth
/// keeps the interpolation error between layers small.
const VOLUME_LAYERS: u32 = 129;
const VOLUME_MAX_DEPTH: f64 = 8.0;

/// Creates the textures of a sampled table and the passes that fill them.
pub(super) fn table(
    gpu: &Gpu,
    pieces: &LinearPieces,
    opacity: f64,
    wanted: &TableRequest,
) -> Result<Table> {
    let size = match (wanted.form, wanted.size) {
        (TableKind::Samples(_), _) => SAMPLED_SIZE,
        (_, Some(size)) => size,
        (_, None) => pieces.required_size(opacity, wanted.accuracy),
    };
    let (layers, reach) = match wanted.form {
        TableKind::Sliced => (slices(opacity * MAX_SEGMENT_LENGTH), 1.0),
        TableKind::Volume => (
            wanted.size.map_or(VOLUME_LAYERS, |n| n.min(MAX_LAYERS)),
            (opacity * wanted.longest_segment).clamp(1e-6, VOLUME_MAX_DEPTH) as f32,
        ),
        _ => (1, 1.0),
    };
    let height = match wanted.form {
        TableKind::Samples(_) => 1,
        _ => size,
    };
    let texture = gpu.texture(
        "pre-integrated table",
        [size, height, layers],
        wanted.texel.format(),
        wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
    )?;
    let builder = Builder {
        gpu,
        size,
        height,
        texel: wanted.texel,
        texture: &texture,
        limit: work_texture(gpu, [size, height], BUILD_FORMAT)?,
        halves: work_texture(gpu, [size, height], TableTexel::Half.format())?,
    };
    let mut passes = Vec::new();
    match wanted.form {
        TableKind::Sliced => {
            passes.push(builder.limit_pass(&pieces.list)?);
            builder.slices(layers, &mut passes)?;
        }
        TableKind::Volume => {
            passes.push(builder.limit_pass(&pieces.list)?);
            builder.volume(layers, reach, &mut passes)?;
        }
        _ => builder.samples(&pieces.list, &mut passes)?,
    }
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    Ok(Table {
        form: wanted.form,
        view,
        size,
        layers,
        max_depth: reach,
        opacity: opacity as f32,
        // Scalars 0 and 1 map to the centres of the first and last texel.
        scalar: [(size as f32 - 1.0) / size as f32, 0.5 / size as f32],
        constants: match wanted.form {
            TableKind::Samples(n) => vec![("SAMPLES", f64::from(n))],
            TableKind::Volume => vec![("INTEGRATION_CUTOFF", wanted.opaque)],
            _ => Vec::new(),
        },
        passes,
    })
}

/// Returns the number of slices for depths up to `depth`.
fn slices(depth: f64) -> u32 {
    let octaves = depth.max(1e-9).log2().ceil() as i32 - FIRST_OCTAVE;
    (octaves.clamp(1, MAX_OCTAVES as i32) as u32) << OCTAVE_BITS
}

/// Returns the depth at the middle of slice `k`.
fn slice_depth(k: u32) -> f64 {
    let steps = 1u32 << OCTAVE_BITS;
    let within = (f64::from(k % steps) + 0.5) / f64::from(steps);
    2f64.powi(FIRST_OCTAVE + (k / steps) as i32) * (1.0 + within)
}

/// Format in which tables are computed.
const BUILD_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

fn work_texture(
    gpu: &Gpu,
    size: [u32; 2],
    format: wgpu::TextureFormat,
) -> Result<wgpu::TextureView> {
    gpu.target(
        "table work",
        size,
        format,
        wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
    )
}

struct Builder<'a> {
    gpu: &'a Gpu,
    size: u32,
    height: u32,
    texel: TableTexel,
    texture: &'a wgpu::Texture,
    limit: wgpu::TextureView,
    /// Half-float scratch output for passes whose layer is not in half floats.
    halves: wgpu::TextureView,
}

impl Builder<'_> {
    fn groups(&self) -> [u32; 3] {
        [self.size.div_ceil(8), self.height.div_ceil(8), 1]
    }

    fn work(&self) -> Result<wgpu::TextureView> {
        work_texture(self.gpu, [self.size, self.height], BUILD_FORMAT)
    }

    /// Returns the half-float output of the pass for layer `k`; see [`Builder::keep`].
    fn written(&self, k: u32) -> wgpu::TextureView {
        match self.texel {
            TableTexel::Half => self.layer(k),
            _ => self.halves.clone(),
        }
    }

    /// Copies `whole` into layer `k` if the table is not in half floats.
    fn keep(&self, whole: &wgpu::TextureView, k: u32, passes: &mut Vec<Pass>) -> Result<()> {
        let shader = match self.texel {
            TableTexel::Half => return Ok(()),
            TableTexel::Byte => "render/table_copy_8bit",
            TableTexel::Single => "render/table_copy_float",
        };
        let layer = self.layer(k);
        let pass = self.gpu.pass(shader).read(whole).write(&layer);
        passes.push(pass.dispatch_workgroups(self.groups())?);
        Ok(())
    }

    fn layer(&self, k: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: k,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }

    fn limit_pass(&self, pieces: &[Piece]) -> Result<Pass> {
        let buffer = self.gpu.buffer_of("transfer pieces", pieces)?;
        self.gpu
            .pass("render/table_limit")
            .read(&buffer)
            .write(&self.limit)
            .params(&gpu_data::Limit {
                size: self.size,
                pieces: pieces.len() as u32,
            })
            .dispatch_workgroups(self.groups())
    }

    /// Computes each slice from the slice one octave below.
    fn slices(&self, layers: u32, passes: &mut Vec<Pass>) -> Result<()> {
        let octave = 1 << OCTAVE_BITS;
        let ring: Vec<_> = (0..2 * octave)
            .map(|_| self.work())
            .collect::<Result<_>>()?;
        for k in 0..layers as usize {
            let halves = match k.checked_sub(octave) {
                Some(before) => &ring[before % ring.len()],
                None => &self.limit,
            };
            let whole = &ring[k % ring.len()];
            passes.push(
                self.gpu
                    .pass("render/table_slice")
                    .read(halves)
                    .write(whole)
                    .write(&self.written(k as u32))
                    .params(&gpu_data::Slice {
                        size: self.size,
                        half_depth: (0.5 * slice_depth(k as u32)) as f32,
                    })
                    .dispatch_workgroups(self.groups())?,
            );
            self.keep(whole, k as u32, passes)?;
        }
        Ok(())
    }

    /// Writes colour and extinction along one line of texels.
    fn samples(&self, pieces: &[Piece], passes: &mut Vec<Pass>) -> Result<()> {
        let buffer = self.gpu.buffer_of("transfer pieces", pieces)?;
        passes.push(
            self.gpu
                .pass("render/table_samples")
                .read(&buffer)
                .write(&self.limit)
                .write(&self.written(0))
                .params(&gpu_data::Limit {
                    size: self.size,
                    pieces: pieces.len() as u32,
                })
                .dispatch_workgroups(self.groups())?,
        );
        self.keep(&self.limit, 0, passes)
    }

    /// Computes each layer from a first slab and the previous layer.
    fn volume(&self, layers: u32, reach: f32, passes: &mut Vec<Pass>) -> Result<()> {
        let slab = self.work()?;
        let others = [self.work()?, self.work()?];
        for k in 0..layers {
            let [first, before, whole] = match k {
                0 => [&self.limit, &self.limit, &others[0]],
                1 => [&self.limit, &self.limit, &slab],
                2 => [&slab, &slab, &others[0]],
                _ => [
                    &slab,
                    &others[(k as usize - 1) % 2],
                    &others[k as usize % 2],
                ],
            };
            passes.push(
                self.gpu
                    .pass("render/table_volume")
                    .read(&self.limit)
                    .read(first)
                    .read(before)
                    .write(whole)
                    .write(&self.written(k))
                    .params(&gpu_data::VolumeLayer {
                        size: self.size,
                        layer: k,
                        depth: reach / (layers - 1) as f32,
                    })
                    .dispatch_workgroups(self.groups())?,
            );
            self.keep(whole, k, passes)?;
        }
        Ok(())
    }
}
