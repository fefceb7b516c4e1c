//! The pre-integrated table: colour and opacity of a ray segment from its two scalars and its
//! length, built on the GPU when the transfer function changes and never when the mesh moves.
//!
//! The sliced form holds mean colour and mean extinction for depths in quarter octaves: opacity
//! 1 − exp(−τ̄ d) is exact for any length, and only the order of colours inside a segment is left
//! to the nearest slice. The volume is the paper's: colour and opacity, linear in depth. Without
//! integration beforehand, a line of texels holds the transfer function itself.
//! Depths are lengths times the largest extinction times log₂ e.

use super::ResolvedTransfer;
use crate::gpu::{Gpu, Pass};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Piece {
            pub ends: [f32; 4],
            pub first: [f32; 4],
            pub last: [f32; 4],
        }
    }
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
        pub(super) struct Slab {
            pub size: u32,
            pub layer: u32,
            pub depth: f32,
        }
    }
}

/// How segments are looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TableForm {
    /// Slices of mean colour and mean extinction: faster, and exact in opacity.
    #[default]
    Sliced,
    /// The paper's three-dimensional table of colour and opacity.
    Volume,
    /// Nothing is integrated beforehand: the transfer function at so many points of each segment,
    /// evenly spread, 1 to 64.
    Samples(u32),
}

impl TableForm {
    /// Its number in `lib/segment.wgsl`.
    pub(super) fn code(self) -> f64 {
        match self {
            TableForm::Sliced => 0.0,
            TableForm::Volume => 1.0,
            TableForm::Samples(_) => 2.0,
        }
    }

    /// Points of a segment at which the transfer function is evaluated.
    pub(super) fn samples(self) -> f64 {
        match self {
            TableForm::Samples(n) => f64::from(n),
            _ => 1.0,
        }
    }

    pub(super) fn check(self) -> Result<()> {
        match self {
            TableForm::Samples(n) if !(1..=64).contains(&n) => Err(Error::Input(format!(
                "{n} samples a tet: choose from 1 to 64"
            ))),
            _ => Ok(()),
        }
    }
}

/// What a table's values are held in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TableTexel {
    /// Bytes, 256 levels from 0 to 1.
    Byte,
    /// Half floats: every device filters them.
    #[default]
    Half,
    /// Floats, where the device filters them.
    Single,
}

impl TableTexel {
    fn format(self) -> wgpu::TextureFormat {
        match self {
            TableTexel::Byte => wgpu::TextureFormat::Rgba8Unorm,
            TableTexel::Half => wgpu::TextureFormat::Rgba16Float,
            TableTexel::Single => wgpu::TextureFormat::Rgba32Float,
        }
    }

    pub(super) fn check(self, gpu: &Gpu) -> Result<()> {
        if self == TableTexel::Single && !gpu.has(wgpu::Features::FLOAT32_FILTERABLE) {
            return Err(Error::Input(
                "this device does not filter 32-bit floats: use a table of half floats".into(),
            ));
        }
        Ok(())
    }
}

/// Slices an octave of depth, as log₂; `lib/segment.wgsl` has the same numbers.
const OCTAVE_BITS: u32 = 2;
/// The first octave of depths begins at 2 to this.
const FIRST_OCTAVE: i32 = -5;
/// Octaves at most: WebGPU's 256 layers hold 64, and depths beyond 2¹⁹ are opaque.
const MOST_OCTAVES: u32 = 24;
/// Slices reach to segments this long, in local units: longer than any body stays.
const LONGEST: f64 = 4.0;
/// Sizes of the table along each scalar.
const SIZES: [u32; 4] = [64, 128, 256, 512];
/// Sizes that may be asked for.
pub(super) const TABLE_SIZES: std::ops::RangeInclusive<u32> = 8..=512;
/// Texels along the scalar where nothing is integrated beforehand.
const SAMPLED_SIZE: u32 = 4096;
/// WebGPU's limit on the layers of a texture.
const MOST_LAYERS: u32 = 256;
/// Layers of the volume, and the depth of the last at most: a layer a sixteenth, so that
/// interpolation between them misses little.
const VOLUME_LAYERS: u32 = 129;
const VOLUME_REACH: f64 = 8.0;

/// A table on the GPU, and the passes that fill it.
pub(super) struct Table {
    /// All layers, to be sampled.
    pub view: wgpu::TextureView,
    /// Texels along each scalar.
    pub size: u32,
    /// Number of layers.
    pub layers: u32,
    /// Depth of the volume's last layer.
    pub reach: f32,
    /// Largest extinction per local unit, times log₂ e.
    pub opacity: f32,
    /// What fills it; none once that is submitted.
    passes: Vec<Pass>,
}

/// What a table is made for.
pub(super) struct Wanted<'a> {
    /// Sliced, volume or none.
    pub form: TableForm,
    /// What its values are held in.
    pub texel: TableTexel,
    /// Texels along each scalar, if not chosen for `accuracy`.
    pub size: Option<u32>,
    /// The transfer function, in file units.
    pub transfer: &'a ResolvedTransfer,
    /// The scalars it covers.
    pub range: (f64, f64),
    /// File units in a local unit.
    pub scale: f64,
    /// Longest segment to expect, in local units.
    pub longest: f64,
    /// Error of a picture's values aimed for.
    pub accuracy: f64,
}

impl Table {
    /// Prepares the table's textures and passes; see [`Table::fill`].
    pub fn new(gpu: &Gpu, wanted: &Wanted) -> Result<Table> {
        let pieces = Pieces::new(wanted.transfer, wanted.range);
        let opacity = pieces.max_extinction * wanted.scale * std::f64::consts::LOG2_E;
        if !(opacity as f32).is_finite() {
            return Err(Error::Input(format!(
                "an extinction of {} per unit of length is too much for a mesh of extent {}",
                pieces.max_extinction, wanted.scale
            )));
        }
        let size = match (wanted.form, wanted.size) {
            (TableForm::Samples(_), _) => SAMPLED_SIZE,
            (_, Some(size)) => size,
            (_, None) => pieces.table_size(opacity, wanted.accuracy),
        };
        let (layers, reach) = match wanted.form {
            TableForm::Sliced => (slices(opacity * LONGEST), 1.0),
            TableForm::Volume => (
                wanted.size.map_or(VOLUME_LAYERS, |n| n.min(MOST_LAYERS)),
                (opacity * wanted.longest).clamp(1e-6, VOLUME_REACH) as f32,
            ),
            TableForm::Samples(_) => (1, 1.0),
        };
        let height = match wanted.form {
            TableForm::Samples(_) => 1,
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
            limit: work_texture(gpu, [size, height], WORK)?,
            halves: work_texture(gpu, [size, height], TableTexel::Half.format())?,
        };
        let mut passes = Vec::new();
        match wanted.form {
            TableForm::Sliced => {
                passes.push(builder.limit_pass(&pieces.list)?);
                builder.slices(layers, &mut passes)?;
            }
            TableForm::Volume => {
                passes.push(builder.limit_pass(&pieces.list)?);
                builder.volume(layers, reach, &mut passes)?;
            }
            TableForm::Samples(_) => builder.samples(&pieces.list, &mut passes)?,
        }
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Ok(Table {
            view,
            size,
            layers,
            reach,
            opacity: opacity as f32,
            passes,
        })
    }

    /// Submits the building of the table, once: before all that reads it, whichever recording of
    /// that is submitted, and in what order.
    pub fn fill(&mut self, gpu: &Gpu) -> Result<()> {
        if self.passes.is_empty() {
            return Ok(());
        }
        let mut work = gpu.record();
        self.passes.iter().for_each(|pass| pass.record(&mut work));
        work.submit()?;
        self.passes.clear();
        Ok(())
    }

    /// Table coordinate of a scalar s from 0 to 1: first · s + second, texel centres at the ends.
    pub fn scalar(&self) -> [f32; 2] {
        let size = self.size as f32;
        [(size - 1.0) / size, 0.5 / size]
    }
}

/// Slices needed for depths up to `depth`.
fn slices(depth: f64) -> u32 {
    let octaves = depth.max(1e-9).log2().ceil() as i32 - FIRST_OCTAVE;
    (octaves.clamp(1, MOST_OCTAVES as i32) as u32) << OCTAVE_BITS
}

/// The depth in the middle of slice `k`.
fn slice_depth(k: u32) -> f64 {
    let steps = 1u32 << OCTAVE_BITS;
    let within = (f64::from(k % steps) + 0.5) / f64::from(steps);
    2f64.powi(FIRST_OCTAVE + (k / steps) as i32) * (1.0 + within)
}

/// What a table is made in.
const WORK: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

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
    /// What passes write in place of a layer that is not of half floats.
    halves: wgpu::TextureView,
}

impl Builder<'_> {
    fn groups(&self) -> [u32; 3] {
        [self.size.div_ceil(8), self.height.div_ceil(8), 1]
    }

    fn work(&self) -> Result<wgpu::TextureView> {
        work_texture(self.gpu, [self.size, self.height], WORK)
    }

    /// Where a pass writes layer `k`; see [`Builder::keep`].
    fn written(&self, k: u32) -> wgpu::TextureView {
        match self.texel {
            TableTexel::Half => self.layer(k),
            _ => self.halves.clone(),
        }
    }

    /// Brings `whole` into layer `k` where the pass that made it could not.
    fn keep(&self, whole: &wgpu::TextureView, k: u32, passes: &mut Vec<Pass>) -> Result<()> {
        let shader = match self.texel {
            TableTexel::Half => return Ok(()),
            TableTexel::Byte => "render/table_bytes",
            TableTexel::Single => "render/table_singles",
        };
        let layer = self.layer(k);
        let pass = self.gpu.pass(shader).read(whole).write(&layer);
        passes.push(pass.over_groups(self.groups())?);
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

    fn limit_pass(&self, pieces: &[gpu_data::Piece]) -> Result<Pass> {
        let buffer = self.gpu.buffer_of("transfer pieces", pieces)?;
        self.gpu
            .pass("render/table_limit")
            .read(&buffer)
            .write(&self.limit)
            .params(&gpu_data::Limit {
                size: self.size,
                pieces: pieces.len() as u32,
            })
            .over_groups(self.groups())
    }

    /// Each slice from the one an octave before it.
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
                    .over_groups(self.groups())?,
            );
            self.keep(whole, k as u32, passes)?;
        }
        Ok(())
    }

    /// Colour and extinction themselves, along one line.
    fn samples(&self, pieces: &[gpu_data::Piece], passes: &mut Vec<Pass>) -> Result<()> {
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
                .over_groups(self.groups())?,
        );
        self.keep(&self.limit, 0, passes)
    }

    /// Each layer from a first slab and the layer before it.
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
                    .params(&gpu_data::Slab {
                        size: self.size,
                        layer: k,
                        depth: reach / (layers - 1) as f32,
                    })
                    .over_groups(self.groups())?,
            );
            self.keep(whole, k, passes)?;
        }
        Ok(())
    }
}

/// A transfer function cut where it bends, over scalars from 0 to 1 and a little beyond.
struct Pieces {
    list: Vec<gpu_data::Piece>,
    /// Largest extinction in the range, per file unit.
    max_extinction: f64,
}

impl Pieces {
    fn new(transfer: &ResolvedTransfer, range: (f64, f64)) -> Pieces {
        let span = range.1 - range.0;
        let mut cuts: Vec<f64> = transfer
            .nodes()
            .iter()
            .map(|s| (s - range.0) / span)
            .filter(|s| *s > -1.0 && *s < 2.0)
            .collect();
        cuts.insert(0, -1.0);
        cuts.push(2.0);
        // Both functions are linear inside a piece: two inner points give its ends, jumps included.
        let ends = |a: f64, b: f64| {
            let at = |w: f64| range.0 + span * (a + w * (b - a));
            let line = |p: f64, q: f64| [1.5 * p - 0.5 * q, 1.5 * q - 0.5 * p];
            let (p, q) = (transfer.colour(at(0.25)), transfer.colour(at(0.75)));
            let colour = [0, 1, 2].map(|k| line(p[k], q[k]));
            let [first, last] = line(transfer.extinction(at(0.25)), transfer.extinction(at(0.75)));
            (colour, [first.max(0.0), last.max(0.0)])
        };
        let wide = |pair: &&[f64]| pair[1] - pair[0] > 1e-9;
        let inside = |s: f64| transfer.extinction(range.0 + span * s);
        let max_extinction = cuts
            .windows(2)
            .filter(wide)
            .filter(|pair| pair[0] < 1.0 && pair[1] > 0.0)
            .flat_map(|pair| ends(pair[0].max(0.0), pair[1].min(1.0)).1)
            .fold(inside(0.0).max(inside(1.0)), f64::max);
        let unit = if max_extinction > 0.0 {
            max_extinction
        } else {
            1.0
        };
        let list = cuts
            .windows(2)
            .filter(wide)
            .map(|pair| {
                let (c, t) = ends(pair[0], pair[1]);
                gpu_data::Piece {
                    ends: [pair[0], t[0] / unit, pair[1], t[1] / unit].map(|x| x as f32),
                    first: [c[0][0], c[1][0], c[2][0], 0.0].map(|x| x as f32),
                    last: [c[0][1], c[1][1], c[2][1], 0.0].map(|x| x as f32),
                }
            })
            .collect();
        Pieces {
            list,
            max_extinction,
        }
    }

    /// Texels along each scalar for pictures within `accuracy`: linear interpolation misses a bend
    /// by (change of slope) h²/8 and a jump by (jump) h/4, in extinction over about a mesh's
    /// extent of path, in colour over weights that sum to 1.
    fn table_size(&self, opacity: f64, accuracy: f64) -> u32 {
        // Beyond a depth of some units a ray is opaque, and errors no longer add up.
        let depth = opacity.min(16.0);
        let error = |h: f64| {
            let pairs = self.list.windows(2).map(|pair| {
                let [a, b] = [&pair[0], &pair[1]];
                // Value and slope on either side, of extinction and of each colour.
                let ends = |p: &gpu_data::Piece, k: usize| match k {
                    0 => [p.ends[1], p.ends[3]],
                    _ => [p.first[k - 1], p.last[k - 1]],
                };
                let missed = |k: usize| {
                    let (before, after) = (ends(a, k), ends(b, k));
                    let slope = |p: &gpu_data::Piece, v: [f32; 2]| {
                        f64::from((v[1] - v[0]) / (p.ends[2] - p.ends[0]))
                    };
                    let bend = (slope(b, after) - slope(a, before)).abs();
                    let jump = f64::from((after[0] - before[1]).abs());
                    bend * h * h / 8.0 + jump * h / 4.0
                };
                let colour = (1..4).map(missed).fold(0.0, f64::max);
                [depth * missed(0), colour]
            });
            let most = pairs.fold([0.0f64; 2], |m, e| [m[0].max(e[0]), m[1].max(e[1])]);
            most[0] + most[1]
        };
        let enough = |size: &u32| error(1.0 / f64::from(*size)) <= accuracy;
        SIZES
            .into_iter()
            .find(enough)
            .unwrap_or(SIZES[SIZES.len() - 1])
    }
}
