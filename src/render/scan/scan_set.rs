//! Scans of a raycaster: textures, placement and empty-space data.

use super::labels::{LabelAppearance, LabelIndex};
use super::min_max_pyramid::MinMaxPyramid;
use super::texture::{Texels, texture};
use super::{MAX_SCANS, Scan, ScanAppearance};
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, TetMesh};
use crate::render::table::TableRow;
use crate::render::{AbsoluteTransferFunction, TransferFunction};
use crate::{Error, Result, parallel};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

mod gpu_data {
    crate::gpu_struct! {
        /// Layout of `shaders/terms/scan.wgsl`.
        pub struct Scan {
            pub x: [f32; 4],
            pub y: [f32; 4],
            pub z: [f32; 4],
            pub size: [f32; 4],
            pub look: [f32; 4],
        }
    }
}

/// Bins of the value histogram, and the maximum number of texels sampled for it.
const HISTOGRAM_BINS: usize = 256;
const TEXELS_OF_SPREAD: usize = 1 << 18;
/// Rounding of scalars in the table, relative to their range, and of texels in half floats.
const TABLE_ROUNDING: f64 = 1.0 / 2000.0;
const TEXEL_ROUNDING: f64 = 1.0 / 2048.0;

/// All scans of an image.
pub(in crate::render) struct ScanSet {
    pub scans: Vec<Scan>,
    parts: Vec<ScanData>,
    /// Voxels of all scans.
    pub texture: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    /// Tet count of the mesh for which the data were computed.
    tets: usize,
    /// Descriptions of omitted data.
    pub notes: Vec<String>,
}

/// Data of a scan other than its texels.
#[derive(Clone)]
struct ScanData {
    /// Transform from rest positions, in file units, to texels.
    texel_from_rest: DAffine3,
    size: [usize; 3],
    first: u32,
    /// Values of the texels −1 and 1, for a scan of values.
    ends: (f64, f64),
    numbered: Option<LabelIndex>,
    /// Displayed value range.
    range: (f64, f64),
    spread: Arc<[f64]>,
    pyramid: Arc<MinMaxPyramid>,
    /// Texel range in each tet of the mesh.
    of_tets: Vec<Option<[f32; 2]>>,
}

impl ScanSet {
    /// Uploads `scans`, which are attached to `mesh`.
    pub fn new(gpu: &Gpu, mesh: &TetMesh, scans: &[Scan]) -> Result<ScanSet> {
        if !(1..=MAX_SCANS).contains(&scans.len()) {
            return Err(Error::Input(format!(
                "number of scans in an image must be 1 to {MAX_SCANS}, got {}",
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

    /// Returns the scan set for `mesh` after a cut that removed tets.
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

    /// Returns the tet count of the mesh for which the data were computed.
    pub fn tets(&self) -> usize {
        self.tets
    }

    /// Returns the transfer function of the first scan, or `None` if it shows labels.
    pub fn transfer(&self) -> Option<&TransferFunction> {
        match &self.scans[0].appearance {
            ScanAppearance::Values { transfer, .. } => Some(transfer),
            ScanAppearance::Labels(_) => None,
        }
    }

    /// Whether any scan shows labels.
    pub fn has_labels(&self) -> bool {
        self.parts.iter().any(|part| part.numbered.is_some())
    }

    /// Returns the smallest texel spacing, in file units.
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

    /// Returns the table rows: the first scan with each of `transfers`, then the other scans.
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
        // A row of labels uses the largest extinction of all labels.
        let labels = |k: usize, part: &ScanData| {
            let looks = part.looks(&self.scans[k].appearance);
            let most = looks.iter().map(|l| l.extinction).fold(0.0, f64::max);
            TableRow {
                transfer: AbsoluteTransferFunction::constant(most),
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

    /// Returns the label appearances with their table row; the first scan has `first` rows.
    pub fn label_rows(&self, first: usize) -> Vec<(usize, Vec<LabelAppearance>)> {
        let rows = self.row_of_scans(first);
        let all = self.scans.iter().zip(&self.parts).zip(rows);
        all.filter(|((_, part), _)| part.numbered.is_some())
            .map(|((scan, part), row)| (row, part.looks(&scan.appearance)))
            .collect()
    }

    /// Returns the row of each scan if the first scan has `first` rows.
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

    /// Uploads the placement of the scans in the layout of `terms/scan.wgsl`.
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
        gpu.buffer_of("scan placements", &items)
    }

    /// Returns the largest extinction of all scans in each tet, per file unit. The first scan has
    /// `first` of `rows`; `row` maps a tet to its row.
    pub fn majorants(
        &self,
        rows: &[TableRow],
        first: usize,
        row: &(dyn Fn(usize) -> usize + Sync),
    ) -> Vec<f64> {
        let in_tet = self.extinctions(rows, first);
        parallel::map(self.tets, |t| {
            // Colours are interpolated between the entries of a table, which widens the range.
            let of_scan = |k: usize| in_tet(k, t, row(t), 2.0).map_or(0.0, |found| found.1);
            (0..self.parts.len()).map(of_scan).sum()
        })
    }

    /// Returns, for each tet, whether all scans are transparent in it and the first scan has none
    /// of the isosurface `values` there. The first scan has `first` of `rows`; `row` maps a tet to
    /// its row.
    pub fn transparent_tets(
        &self,
        rows: &[TableRow],
        first: usize,
        row: &(dyn Fn(usize) -> usize + Sync),
        values: &[f64],
    ) -> Vec<bool> {
        let in_tet = self.extinctions(rows, first);
        parallel::map(self.tets, |t| {
            (0..self.parts.len()).all(|k| match in_tet(k, t, row(t), 1.0) {
                Some((range, extinction)) => {
                    let met = |[low, high]: [f64; 2]| {
                        k == 0 && values.iter().any(|v| (low..=high).contains(v))
                    };
                    !range.is_some_and(met) && extinction <= 0.0
                }
                None => true,
            })
        })
    }

    /// Returns a function of scan, tet, the tet's row and the rounding in units of that of a table,
    /// which returns `None` where the scan does not cover the tet.
    fn extinctions<'a>(
        &'a self,
        rows: &'a [TableRow],
        first: usize,
    ) -> impl Fn(usize, usize, usize, f64) -> Option<RangeAndExtinction> + Sync + 'a {
        let of_scans = self.row_of_scans(first);
        let all = self.scans.iter().zip(&self.parts);
        let looks: Vec<Vec<LabelAppearance>> = all
            .map(|(scan, part)| part.looks(&scan.appearance))
            .collect();
        move |k, t, row, rounding| {
            let part = &self.parts[k];
            let [low, high] = part.of_tets[t]?;
            if part.numbered.is_some() {
                let numbers = LabelIndex::from_texel(low)..=LabelIndex::from_texel(high);
                let shown = looks[k][numbers].iter().map(|look| look.extinction);
                return Some((None, shown.fold(0.0, f64::max)));
            }
            let row = if k == 0 { row } else { of_scans[k] };
            let TableRow {
                transfer, range, ..
            } = &rows[row];
            let off = rounding * TABLE_ROUNDING * (range.1 - range.0)
                + TEXEL_ROUNDING * (part.ends.1 - part.ends.0);
            let values = [part.value(low) - off, part.value(high) + off];
            let [low, high] = values.map(|v| v.clamp(range.0, range.1));
            Some((Some(values), transfer.max_extinction_between(low, high)))
        }
    }
}

/// Range of values of a scan in a tet, `None` for labels, and the largest extinction in it.
type RangeAndExtinction = (Option<[f64; 2]>, f64);

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
        let count: f64 = spread.iter().sum();
        spread.iter_mut().for_each(|part| *part /= count.max(1.0));
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

    /// Returns the value of a texel.
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
