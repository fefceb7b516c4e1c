//! Pre-integrated tables: colour and opacity of a ray segment from its two scalars and its length.
//! A table is rebuilt when the transfer function changes, never when the mesh moves.
//!
//! Integrals of colour and extinction over the scalar ([`integrals`]) give the exact opacity 1 −
//! exp(−τ̄ d) for any length, and the front-to-back order of colours in a segment to second order
//! in its depth. The sliced table stores mean colour and mean extinction for depths in quarter
//! octaves: opacity is exact as well, and the order of colours is that of the nearest slice. The
//! volume table follows the paper: colour and opacity, linear in depth. Without pre-integration,
//! one line of texels stores the transfer function itself. Depth is length times the largest
//! extinction times log₂ e.

mod builder;
mod integrals;
mod linear_pieces;

use super::AbsoluteTransferFunction;
use crate::gpu::{Gpu, Pass};
use crate::{Error, Result};
use linear_pieces::LinearPieces;

/// Lookup method for ray segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TableKind {
    /// Integrals if the tets of the mesh are thin enough for one lookup each, otherwise slices.
    #[default]
    Auto,
    /// Integrals of colour and extinction over the scalar, 4,096 points: the fastest for thin tets,
    /// exact in opacity, and the only form that supports several transfer functions.
    Integrals,
    /// Slices of mean colour and mean extinction for each pair of scalars: exact in opacity.
    Sliced,
    /// Three-dimensional table of colour and opacity, as in the paper.
    Volume,
    /// No pre-integration: evaluates the transfer function at this many evenly spaced points of
    /// each segment, 1 to 64.
    Samples(u32),
}

impl TableKind {
    /// Returns the lookup term in `shaders/terms`; `stored` selects storage reads of the mesh.
    pub(super) fn term(self, stored: bool) -> &'static str {
        match self {
            TableKind::Integrals if stored => "integrals_stored",
            TableKind::Integrals => "integrals",
            TableKind::Auto | TableKind::Sliced => "slices",
            TableKind::Volume => "slabs",
            TableKind::Samples(_) => "points",
        }
    }

    /// Whether the table is read through a sampler.
    pub(super) fn is_sampled(self) -> bool {
        self != TableKind::Integrals
    }

    pub(super) fn check(self) -> Result<()> {
        match self {
            TableKind::Samples(n) if !(1..=64).contains(&n) => Err(Error::Input(format!(
                "samples per tet must be 1 to 64, got {n}"
            ))),
            _ => Ok(()),
        }
    }
}

/// Texel format of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TableTexel {
    /// 8-bit normalised integers, 256 levels from 0 to 1.
    Byte,
    /// Half floats, filterable on every device.
    #[default]
    Half,
    /// 32-bit floats, on devices that can filter them.
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
                "this device cannot filter 32-bit floats; use a table of half floats".into(),
            ));
        }
        Ok(())
    }
}

/// Automatic sizes of a sampled table along each scalar.
const SIZES: [u32; 4] = [64, 128, 256, 512];
/// Allowed range of user-defined sizes.
pub(super) const TABLE_SIZES: std::ops::RangeInclusive<u32> = 8..=512;

/// A table on the GPU, and the passes that fill it.
pub(super) struct Table {
    /// Lookup method; never [`TableKind::Auto`].
    pub form: TableKind,
    /// View of all layers for the lookup term.
    pub view: wgpu::TextureView,
    /// Texels along each scalar.
    pub size: u32,
    /// Number of layers.
    pub layers: u32,
    /// Depth of the last layer of the volume.
    pub max_depth: f32,
    /// Largest extinction per local unit, times log₂ e.
    pub opacity: f32,
    /// Table coordinate of a scalar s from 0 to 1: first · s + second.
    pub scalar: [f32; 2],
    /// Pipeline constants of the lookup term.
    constants: Vec<(&'static str, f64)>,
    /// Passes that fill the table; empty once submitted.
    passes: Vec<Pass>,
}

/// A transfer function in a table.
#[derive(Clone, Debug)]
pub(super) struct TableRow {
    /// Transfer function in file units.
    pub transfer: AbsoluteTransferFunction,
    /// Scalar range covered.
    pub range: (f64, f64),
    /// Histogram: volume fraction per equal-width bin of the range.
    pub spread: std::sync::Arc<[f64]>,
}

/// Specification of a table.
#[derive(Clone, Copy)]
pub(super) struct TableRequest<'a> {
    /// Lookup method.
    pub form: TableKind,
    /// Texel format of a sampled table.
    pub texel: TableTexel,
    /// Texels along each scalar of a sampled table; `None` chooses by `accuracy`.
    pub size: Option<u32>,
    /// Transfer functions, one row each; only a table of integrals supports several.
    pub rows: &'a [TableRow],
    /// File units per local unit.
    pub scale: f64,
    /// Longest expected segment, in local units.
    pub longest_segment: f64,
    /// Mean expected segment, in local units.
    pub mean_segment: f64,
    /// Error tolerance of pixel values.
    pub accuracy: f64,
    /// Opacity at which rays end (early ray termination).
    pub opaque: f64,
}

/// Splits the transfer functions of `wanted` into linear pieces.
fn pieces_of(wanted: &TableRequest) -> Vec<LinearPieces> {
    let pieces = |row: &TableRow| LinearPieces::new(&row.transfer, row.range);
    wanted.rows.iter().map(pieces).collect()
}

/// Resolves [`TableKind::Auto`].
fn chosen(pieces: &[LinearPieces], wanted: &TableRequest) -> TableKind {
    match wanted.form {
        TableKind::Auto if pieces.len() > 1 => TableKind::Integrals,
        TableKind::Auto if integrals::is_sufficient(pieces, wanted) => TableKind::Integrals,
        TableKind::Auto => TableKind::Sliced,
        form => form,
    }
}

impl Table {
    /// Whether the table form is still the one chosen for `wanted`.
    pub fn matches(&self, wanted: &TableRequest) -> bool {
        // The form is chosen only for `Auto` with a single row.
        let fitting = wanted.form == TableKind::Auto && wanted.rows.len() == 1;
        !fitting || self.form == chosen(&pieces_of(wanted), wanted)
    }

    /// Creates the textures and passes of the table; see [`Table::fill`].
    pub fn new(gpu: &Gpu, wanted: &TableRequest) -> Result<Table> {
        let pieces = pieces_of(wanted);
        let most = pieces.iter().map(|p| p.max_extinction).fold(0.0, f64::max);
        let opacity = most * wanted.scale * std::f64::consts::LOG2_E;
        if !(opacity as f32).is_finite() {
            return Err(Error::Input(format!(
                "extinction {most} per length unit is too large for a mesh of extent {}; reduce the extinction",
                wanted.scale
            )));
        }
        let form = chosen(&pieces, wanted);
        match (form, pieces.as_slice()) {
            (TableKind::Integrals, _) => integrals::table(gpu, &pieces, (most, opacity), wanted),
            (_, [only]) => builder::table(gpu, only, opacity, &TableRequest { form, ..*wanted }),
            _ => Err(Error::Input(
                "transfer functions per region need a table of integrals; use TableKind::Integrals or TableKind::Auto".into(),
            )),
        }
    }

    /// Returns the pipeline constants of the lookup term.
    pub fn constants(&self) -> &[(&'static str, f64)] {
        &self.constants
    }

    /// Submits the computation of the table once, before any recording that reads it is submitted,
    /// in whichever order these are.
    pub fn fill(&mut self, gpu: &Gpu) -> Result<()> {
        if self.passes.is_empty() {
            return Ok(());
        }
        let mut work = gpu.start_recording();
        self.passes.iter().for_each(|pass| pass.record(&mut work));
        work.submit()?;
        self.passes.clear();
        Ok(())
    }
}
