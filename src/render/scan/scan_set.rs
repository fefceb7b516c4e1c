//! Scans as a raycaster keeps them.

use super::labels::{LabelAppearance, LabelIndex};
use super::min_max_pyramid::MinMaxPyramid;
use super::texture::{Texels, texture};
use super::{MAX_SCANS, Scan, ScanAppearance};
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, TetMesh};
use crate::render::table::TableRow;
use crate::render::{ResolvedTransfer, TransferFunction};
use crate::{Error, Result, parallel};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/terms/scan.wgsl`.
        pub struct Scan {
            pub x: [f32; 4],
            pub y: [f32; 4],
            pub z: [f32; 4],
            pub size: [f32; 4],
            pub look: [f32; 4],
        }
    }
}

/// Parts of the range that are told apart where it is asked what is frequent, and texels that are
/// looked at for it.
const HISTOGRAM_BINS: usize = 256;
const TEXELS_OF_SPREAD: usize = 1 << 18;
/// What the table rounds scalars by, of its range, and half floats texels.
const TABLE_ROUNDING: f64 = 1.0 / 2000.0;
const TEXEL_ROUNDING: f64 = 1.0 / 2048.0;

/// All scans of a picture.
pub(in crate::render) struct ScanSet {
    pub scans: Vec<Scan>,
    parts: Vec<ScanData>,
    /// Their voxels.
    pub texture: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    /// Tets of the mesh that it was made for.
    tets: usize,
    /// What had to be left out.
    pub notes: Vec<String>,
}

/// What is kept of a scan beside its texels.
#[derive(Clone)]
struct ScanData {
    /// From places at rest, in file units.
    texel_from_rest: DAffine3,
    size: [usize; 3],
    first: u32,
    /// The values of texels −1 and 1, of values.
    ends: (f64, f64),
    numbered: Option<LabelIndex>,
    /// The values that are told apart.
    range: (f64, f64),
    spread: Arc<[f64]>,
    pyramid: Arc<MinMaxPyramid>,
    /// Bounds of the texels in each tet of the mesh.
    of_tets: Vec<Option<[f32; 2]>>,
}

impl ScanSet {
    /// `scans`, which `mesh` carries.
    pub fn new(gpu: &Gpu, mesh: &TetMesh, scans: &[Scan]) -> Result<ScanSet> {
        if !(1..=MAX_SCANS).contains(&scans.len()) {
            return Err(Error::Input(format!(
                "{} scans: a picture has up to {MAX_SCANS}",
                scans.len()
            )));
        }
        scans.iter().try_for_each(|scan| scan.check(mesh))?;
        let (texture, texels, notes) = texture(gpu, scans)?;
        let parts = scans.iter().zip(texels);
        Ok(ScanSet {
            parts: parts
                .map(|(scan, texels)| ScanData::new(scan, texels, mesh))
                .collect(),
            scans: scans.to_vec(),
            texture,
            sampler: gpu.device().create_sampler(&wgpu::SamplerDescriptor {
                label: Some("scans"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            tets: mesh.tets.len(),
            notes,
        })
    }

    /// The same in `mesh` after a cut, which has taken tets away.
    pub fn follow(&self, mesh: &TetMesh) -> ScanSet {
        let of_tets = |part: &ScanData| ScanData {
            of_tets: part.pyramid.tet_ranges(mesh, part.texel_from_rest),
            ..part.clone()
        };
        ScanSet {
            scans: self.scans.clone(),
            parts: self.parts.iter().map(of_tets).collect(),
            texture: self.texture.clone(),
            sampler: self.sampler.clone(),
            tets: mesh.tets.len(),
            notes: Vec::new(),
        }
    }

    /// Tets of the mesh that it was made for.
    pub fn tets(&self) -> usize {
        self.tets
    }

    /// Whether the first one shows values, by this transfer function.
    pub fn transfer(&self) -> Option<&TransferFunction> {
        match &self.scans[0].appearance {
            ScanAppearance::Values { transfer, .. } => Some(transfer),
            ScanAppearance::Labels(_) => None,
        }
    }

    /// Whether any of them has labels.
    pub fn has_labels(&self) -> bool {
        self.parts.iter().any(|part| part.numbered.is_some())
    }

    /// The least distance between two texels, in file units.
    pub fn min_texel_spacing(&self) -> f64 {
        let spacing = |part: &ScanData| {
            let axes = part.texel_from_rest.inverse().matrix3;
            axes.x_axis
                .length()
                .min(axes.y_axis.length())
                .min(axes.z_axis.length())
        };
        self.parts.iter().map(spacing).fold(f64::INFINITY, f64::min)
    }

    /// The rows of the table: the first scan by each of `transfers`, then the others.
    pub fn rows(&self, transfers: &[TransferFunction], extent: f64) -> Vec<TableRow> {
        let row = |k: usize, transfer: &TransferFunction| {
            let range = self.parts[k].range;
            TableRow {
                transfer: transfer.to_absolute(range, extent),
                range,
                spread: self.parts[k].spread.clone(),
            }
        };
        let first = transfers.iter().map(|t| row(0, t));
        // A row of labels stands for the densest of them.
        let labels = |k: usize, part: &ScanData| {
            let looks = part.looks(&self.scans[k].appearance);
            let most = looks.iter().map(|l| l.extinction).fold(0.0, f64::max);
            TableRow {
                transfer: ResolvedTransfer::constant(most),
                range: part.range,
                spread: self.parts[k].spread.clone(),
            }
        };
        let others = self.scans.iter().zip(&self.parts).enumerate();
        let others = others.filter_map(|(k, (scan, part))| match &scan.appearance {
            ScanAppearance::Labels(_) => Some(labels(k, part)),
            ScanAppearance::Values { transfer, .. } if k > 0 => Some(row(k, transfer)),
            ScanAppearance::Values { .. } => None,
        });
        first.chain(others).collect()
    }

    /// The colours of labels, by the row of the table that stands for them, after `first` rows.
    pub fn label_rows(&self, first: usize) -> Vec<(usize, Vec<LabelAppearance>)> {
        let rows = self.row_of_scans(first);
        let all = self.scans.iter().zip(&self.parts).zip(rows);
        all.filter(|((_, part), _)| part.numbered.is_some())
            .map(|((scan, part), row)| (row, part.looks(&scan.appearance)))
            .collect()
    }

    /// The row of each scan, where the first scan has `first` of them.
    fn row_of_scans(&self, first: usize) -> Vec<usize> {
        let mut next = first;
        let parts = self.parts.iter().enumerate();
        parts
            .map(|(k, part)| match (k, &part.numbered) {
                (0, None) => 0,
                _ => {
                    next += 1;
                    next - 1
                }
            })
            .collect()
    }

    /// As `terms/scan.wgsl` reads them.
    pub fn to_gpu(&self, gpu: &Gpu, frame: LocalFrame, first: usize) -> Result<wgpu::Buffer> {
        let to_file = DAffine3::from_translation(frame.origin)
            * DAffine3::from_scale(DVec3::splat(frame.scale));
        let rows = self.row_of_scans(first);
        let parts = self.parts.iter().zip(rows);
        let items: Vec<gpu_data::Scan> = parts
            .map(|(part, row)| {
                let m = part.texel_from_rest * to_file;
                let axis = |k: usize| {
                    let row = m.matrix3.row(k);
                    row.extend(m.translation[k]).as_vec4().to_array()
                };
                let (low, high) = part.range;
                let per_texel = 0.5 * (part.ends.1 - part.ends.0) / (high - low);
                let shift = (part.ends.0 - low) / (high - low) + per_texel;
                let [nx, ny, nz] = part.size.map(|n| n as f32);
                let labels = f32::from(u8::from(part.numbered.is_some()));
                gpu_data::Scan {
                    x: axis(0),
                    y: axis(1),
                    z: axis(2),
                    size: [nx, ny, nz, part.first as f32],
                    look: [per_texel as f32, shift as f32, row as f32, labels],
                }
            })
            .collect();
        gpu.buffer_of("places of scans", &items)
    }

    /// Of each tet of the mesh whether all scans are transparent in it, and the first has none of
    /// `values`. Of `rows` the first scan has `first`, and `row` tells which in a tet.
    pub fn transparent_tets(
        &self,
        rows: &[TableRow],
        first: usize,
        row: &(dyn Fn(usize) -> usize + Sync),
        values: &[f64],
    ) -> Vec<bool> {
        let of_scans = self.row_of_scans(first);
        let looks: Vec<Vec<LabelAppearance>> = self
            .scans
            .iter()
            .zip(&self.parts)
            .map(|(scan, part)| part.looks(&scan.appearance))
            .collect();
        parallel::map(self.tets, |t| {
            self.parts.iter().enumerate().all(|(k, part)| {
                let Some([low, high]) = part.of_tets[t] else {
                    return true;
                };
                if part.numbered.is_some() {
                    let shown = |look: &LabelAppearance| look.extinction > 0.0;
                    let numbers = LabelIndex::from_texel(low)..=LabelIndex::from_texel(high);
                    return !looks[k][numbers].iter().any(shown);
                }
                let TableRow {
                    transfer, range, ..
                } = &rows[match k {
                    0 => row(t),
                    k => of_scans[k],
                }];
                let off = TABLE_ROUNDING * (range.1 - range.0)
                    + TEXEL_ROUNDING * (part.ends.1 - part.ends.0);
                let [low, high] = [part.value(low) - off, part.value(high) + off];
                let met = k == 0 && values.iter().any(|v| (low..=high).contains(v));
                let [low, high] = [low, high].map(|v| v.clamp(range.0, range.1));
                !met && transfer.max_extinction_between(low, high) <= 0.0
            })
        })
    }
}

impl ScanData {
    fn new(scan: &Scan, texels: Texels, mesh: &TetMesh) -> ScanData {
        let texel_from_rest = texels.texel_from_voxel() * scan.rest_to_voxel();
        let pyramid = MinMaxPyramid::new(&texels);
        let of_tets = pyramid.tet_ranges(mesh, texel_from_rest);
        let range = scan.range();
        let (low, high) = range;
        let mut spread = vec![0.0; HISTOGRAM_BINS];
        let every = texels.values.len().div_ceil(TEXELS_OF_SPREAD).max(1);
        for texel in texels.values.iter().step_by(every) {
            let share = (texels.value(f64::from(*texel)) - low) / (high - low);
            spread[((share * HISTOGRAM_BINS as f64).max(0.0) as usize).min(HISTOGRAM_BINS - 1)] +=
                1.0;
        }
        let whole: f64 = spread.iter().sum();
        spread.iter_mut().for_each(|part| *part /= whole.max(1.0));
        ScanData {
            texel_from_rest,
            size: texels.size,
            first: texels.first,
            ends: texels.ends,
            numbered: texels.label_index,
            range,
            spread: spread.into(),
            pyramid: Arc::new(pyramid),
            of_tets,
        }
    }

    /// The value that a texel stands for.
    fn value(&self, texel: f32) -> f64 {
        self.ends.0 + 0.5 * (f64::from(texel) + 1.0) * (self.ends.1 - self.ends.0)
    }

    fn looks(&self, look: &ScanAppearance) -> Vec<LabelAppearance> {
        match (look, &self.numbered) {
            (ScanAppearance::Labels(looks), Some(numbered)) => numbered.appearances(looks),
            _ => Vec::new(),
        }
    }
}
