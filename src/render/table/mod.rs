//! The pre-integrated table: colour and opacity of a ray segment from its two scalars and its
//! length, made when the transfer function changes and never when the mesh moves.
//!
//! Integrals of colour and extinction over the scalar ([`integrals`]) give opacity 1 − exp(−τ̄ d)
//! exactly, for any length, and the order of colours inside a segment to the second order of its
//! depth. The sliced form holds mean colour and mean extinction for depths in quarter octaves:
//! opacity is exact as well, and the order of colours is left to the nearest slice. The volume is
//! the paper's: colour and opacity, linear in depth. Without integration beforehand, a line of
//! texels holds the transfer function itself.
//! Depths are lengths times the largest extinction times log₂ e.

mod builder;
mod integrals;
mod linear_pieces;

use super::ResolvedTransfer;
use crate::gpu::{Gpu, Pass};
use crate::{Error, Result};
use linear_pieces::LinearPieces;

/// How segments are looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum TableKind {
    /// Integrals where a mesh's tets are thin enough for one look-up each, slices where not.
    #[default]
    Auto,
    /// Integrals of colour and extinction over the scalar, 4,096 points: the fastest where tets are
    /// thin, exact in opacity, and alone with room for several transfer functions.
    Integrals,
    /// Slices of mean colour and mean extinction between every two scalars: exact in opacity.
    Sliced,
    /// The paper's three-dimensional table of colour and opacity.
    Volume,
    /// Nothing is integrated beforehand: the transfer function at so many points of each segment,
    /// evenly spread, 1 to 64.
    Samples(u32),
}

impl TableKind {
    /// The term in `shaders/terms` that looks it up; `stored` says how the mesh is read.
    pub(super) fn term(self, stored: bool) -> &'static str {
        match self {
            TableKind::Integrals if stored => "integrals_stored",
            TableKind::Integrals => "integrals",
            TableKind::Auto | TableKind::Sliced => "slices",
            TableKind::Volume => "slabs",
            TableKind::Samples(_) => "points",
        }
    }

    /// Whether it is looked up through a sampler.
    pub(super) fn is_sampled(self) -> bool {
        self != TableKind::Integrals
    }

    pub(super) fn check(self) -> Result<()> {
        match self {
            TableKind::Samples(n) if !(1..=64).contains(&n) => Err(Error::Input(format!(
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

/// Sizes of a sampled table along each scalar.
const SIZES: [u32; 4] = [64, 128, 256, 512];
/// Sizes that may be asked for.
pub(super) const TABLE_SIZES: std::ops::RangeInclusive<u32> = 8..=512;

/// A table on the GPU, and the passes that fill it.
pub(super) struct Table {
    /// How it is looked up: not [`TableKind::Auto`].
    pub form: TableKind,
    /// All layers, as its term reads them.
    pub view: wgpu::TextureView,
    /// Texels along each scalar.
    pub size: u32,
    /// Number of layers.
    pub layers: u32,
    /// Depth of the volume's last layer.
    pub max_depth: f32,
    /// Largest extinction per local unit, times log₂ e.
    pub opacity: f32,
    /// Table coordinate of a scalar s from 0 to 1: first · s + second.
    pub scalar: [f32; 2],
    /// The constants of its term.
    constants: Vec<(&'static str, f64)>,
    /// What fills it; none once that is submitted.
    passes: Vec<Pass>,
}

/// A transfer function of a table.
#[derive(Clone, Debug)]
pub(super) struct TableRow {
    /// In file units.
    pub transfer: ResolvedTransfer,
    /// The scalars it covers.
    pub range: (f64, f64),
    /// The share of the volume whose scalar lies in each of equal parts of the range.
    pub spread: std::sync::Arc<[f64]>,
}

/// What a table is made for.
#[derive(Clone, Copy)]
pub(super) struct TableRequest<'a> {
    /// How it is looked up.
    pub form: TableKind,
    /// What its values are held in, where they are sampled.
    pub texel: TableTexel,
    /// Texels along each scalar where they are sampled, if not chosen for `accuracy`.
    pub size: Option<u32>,
    /// What is looked up: a row each of integrals, which alone can be several.
    pub rows: &'a [TableRow],
    /// File units in a local unit.
    pub scale: f64,
    /// Longest segment to expect, in local units.
    pub longest_segment: f64,
    /// Mean segment to expect, in local units.
    pub mean_segment: f64,
    /// Error of a picture's values aimed for.
    pub accuracy: f64,
    /// The opacity at which rays end.
    pub opaque: f64,
}

/// The transfer functions of `wanted` in pieces.
fn pieces_of(wanted: &TableRequest) -> Vec<LinearPieces> {
    let pieces = |row: &TableRow| LinearPieces::new(&row.transfer, row.range);
    wanted.rows.iter().map(pieces).collect()
}

/// The form that [`TableKind::Auto`] stands for.
fn chosen(pieces: &[LinearPieces], wanted: &TableRequest) -> TableKind {
    match wanted.form {
        TableKind::Auto if pieces.len() > 1 => TableKind::Integrals,
        TableKind::Auto if integrals::is_sufficient(pieces, wanted) => TableKind::Integrals,
        TableKind::Auto => TableKind::Sliced,
        form => form,
    }
}

impl Table {
    /// Whether it has the form that suits `wanted`.
    pub fn matches(&self, wanted: &TableRequest) -> bool {
        // Nothing is chosen otherwise.
        let fitting = wanted.form == TableKind::Auto && wanted.rows.len() == 1;
        !fitting || self.form == chosen(&pieces_of(wanted), wanted)
    }

    /// Prepares the table's textures and passes; see [`Table::fill`].
    pub fn new(gpu: &Gpu, wanted: &TableRequest) -> Result<Table> {
        let pieces = pieces_of(wanted);
        let most = pieces.iter().map(|p| p.max_extinction).fold(0.0, f64::max);
        let opacity = most * wanted.scale * std::f64::consts::LOG2_E;
        if !(opacity as f32).is_finite() {
            return Err(Error::Input(format!(
                "an extinction of {most} per unit of length is too much for a mesh of extent {}",
                wanted.scale
            )));
        }
        let form = chosen(&pieces, wanted);
        match (form, pieces.as_slice()) {
            (TableKind::Integrals, _) => integrals::table(gpu, &pieces, (most, opacity), wanted),
            (_, [only]) => builder::table(gpu, only, opacity, &TableRequest { form, ..*wanted }),
            _ => Err(Error::Input(
                "a transfer function for each region needs a table of integrals, and another form was asked for".into(),
            )),
        }
    }

    /// The constants of its term.
    pub fn constants(&self) -> &[(&'static str, f64)] {
        &self.constants
    }

    /// Submits the building of the table, once: before all that reads it, whichever recording of
    /// that is submitted, and in what order.
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
