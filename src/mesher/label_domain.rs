//! The label map of a volume as a domain.

use super::{Domain, RegionVolume};
use crate::parallel;
use crate::volume::Volume;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;

/// Value of bricks whose voxels belong to several regions.
const MIXED_BRICK: u16 = u16::MAX;

/// Displacement of the boundary of a region, in voxels, per unit of added weight: the weights on
/// both sides of a flat boundary change by 3/4 per voxel, and staircases have 1.5 times the faces
/// of the slope that they approximate.
const BOUNDARY_SHIFT_PER_WEIGHT: f64 = 1.0 / (2.0 * 0.75) / 1.5;

/// Weight of a label at the centre of its voxel from that voxel, and from each voxel of the same
/// label that shares a face with it.
const OWN_WEIGHT: f64 = 0.75 * 0.75 * 0.75;
const FACE_WEIGHT: f64 = 0.125 * 0.75 * 0.75;

/// Factor of the weights of a region of which smoothing would leave less than half: a lone voxel
/// then keeps about its volume.
const THIN_GAIN: f64 = 3.5;

/// The label map of a volume: each voxel's label, and 0 beyond the volume, smoothed by the
/// quadratic B-spline over the nearest 3 × 3 × 3 voxels.
///
/// A flat boundary between two labels lies half-way between their voxels; staircases of voxels are
/// smoothed.
///
/// Smoothing removes parts without two neighbours of the same label, such as lone voxels and
/// diagonal lines of voxels. A region that consists of such parts is kept: its weights are
/// multiplied.
#[derive(Debug)]
pub struct LabelDomain {
    size: [usize; 3],
    /// The region of each voxel.
    regions: Vec<u16>,
    /// Regions of bricks of 2³, 4³, … voxels, or [`MIXED_BRICK`].
    bricks: Vec<([usize; 3], Vec<u16>)>,
    labels: Vec<i64>,
    voxels: Vec<usize>,
    /// The number of voxels of each region that smoothing removes.
    smoothed_away: Vec<usize>,
    /// Factors of the weights of each region; empty if all are 1.
    gains: Vec<f64>,
    /// The bounding box of all regions, in voxels.
    extent: (DVec3, DVec3),
    to_world: DAffine3,
    to_index: DAffine3,
}

impl LabelDomain {
    /// Creates the regions of `volume` with the given labels, in that order; for `None`, those of
    /// all labels except 0, ascending.
    ///
    /// # Errors
    /// An error if no voxel has one of the labels, for more than 65,534 labels, for non-integer
    /// values, and for a volume without an extent.
    pub fn new(volume: &Volume, labels: Option<&[i64]>) -> Result<LabelDomain> {
        let to_index = volume.to_world.inverse();
        if !to_index.is_finite() {
            return Err(Error::Input(
                "cannot mesh a degenerate volume: its axes are linearly dependent".into(),
            ));
        }
        let count = volume.voxels().min(volume.raw.len());
        let labels = match labels {
            Some(labels) => labels.to_vec(),
            None => present(volume)?,
        };
        if labels.len() >= usize::from(MIXED_BRICK) {
            return Err(Error::Input(format!(
                "volume has {} different labels; choose fewer than {MIXED_BRICK}, or define \
                regions by a threshold if it is not a label map",
                labels.len()
            )));
        }
        let number: BTreeMap<i64, u16> = labels.iter().copied().zip(1..).collect();
        let mut last = (f64::NAN, 0);
        let mut regions = vec![0u16; count];
        let mut voxels = vec![0usize; labels.len() + 1];
        for (i, region) in regions.iter_mut().enumerate() {
            let value = volume.value(i);
            if value != last.0 {
                last = (value, number.get(&(value as i64)).copied().unwrap_or(0));
            }
            *region = last.1;
            voxels[usize::from(last.1)] += 1;
        }
        if let Some(absent) = voxels.iter().skip(1).position(|n| *n == 0) {
            return Err(Error::Input(format!(
                "no voxel has label {}; available labels: {}",
                labels[absent],
                listed(&present(volume)?)
            )));
        }
        let mut domain = LabelDomain {
            size: volume.size,
            bricks: Vec::new(),
            extent: extent(&regions, volume.size),
            regions,
            labels,
            voxels,
            smoothed_away: Vec::new(),
            gains: Vec::new(),
            to_world: volume.to_world,
            to_index,
        };
        domain.build_bricks();
        domain.keep_thin_regions();
        Ok(domain)
    }

    /// Returns the label of each region, from region 1 on.
    pub fn labels(&self) -> &[i64] {
        &self.labels
    }

    /// Returns the number of voxels of each region, from region 1 on.
    pub fn voxel_counts(&self) -> &[usize] {
        self.voxels.get(1..).unwrap_or_default()
    }

    /// Returns the fraction of the voxels of each region, from region 1 on, that smoothing removes at
    /// any edge length; 0 for the regions of [`LabelDomain::thin_regions`], which are kept.
    pub fn smoothed_fractions(&self) -> Vec<f64> {
        let counts = self.smoothed_away.iter().zip(&self.voxels).enumerate();
        let fraction = |(region, (lost, all)): (usize, (&usize, &usize))| match self.gain(region) {
            1.0 => *lost as f64 / (*all).max(1) as f64,
            _ => 0.0,
        };
        counts.skip(1).map(fraction).collect()
    }

    /// Returns the labels and numbers of voxels of the regions that smoothing would remove, and
    /// which are kept by an offset of their boundary.
    pub fn thin_regions(&self) -> Vec<(i64, usize)> {
        let regions = (1..self.voxels.len()).filter(|r| self.gain(*r) > 1.0);
        regions
            .map(|r| (self.labels[r - 1], self.voxels[r]))
            .collect()
    }

    fn gain(&self, region: usize) -> f64 {
        self.gains.get(region).copied().unwrap_or(1.0)
    }

    /// Counts the voxels that smoothing removes, and sets the factors of regions that mostly consist
    /// of them.
    fn keep_thin_regions(&mut self) {
        let [nx, ny, nz] = self.size;
        let none = || vec![0usize; self.voxels.len()];
        let counts = parallel::collect(ny * nz, |rows, counts| {
            let mut lost = none();
            let mut weights = Vec::new();
            for row in rows {
                let (j, k) = (row % ny, row / ny);
                for i in 0..nx {
                    let region = self.regions[i + nx * row];
                    if region != 0 && self.is_smoothed_away([i, j, k], region, &mut weights) {
                        lost[usize::from(region)] += 1;
                    }
                }
            }
            counts.push(lost);
        });
        let lost = counts.into_iter().fold(none(), |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        });
        let gain = |(lost, all): (&usize, &usize)| match 2 * lost > *all {
            true => THIN_GAIN,
            false => 1.0,
        };
        let gains: Vec<f64> = lost.iter().zip(&self.voxels).map(gain).collect();
        if gains.iter().any(|g| *g != 1.0) {
            self.gains = gains;
        }
        self.smoothed_away = lost;
    }

    /// Whether a voxel of `region` belongs to another one at its centre.
    fn is_smoothed_away(
        &self,
        voxel: [usize; 3],
        region: u16,
        weights: &mut Vec<(u16, f64)>,
    ) -> bool {
        let [i, j, k] = voxel.map(|c| c as isize);
        let beside = [
            (i - 1, j, k),
            (i + 1, j, k),
            (i, j - 1, k),
            (i, j + 1, k),
            (i, j, k - 1),
            (i, j, k + 1),
        ];
        let same = beside
            .iter()
            .filter(|(i, j, k)| self.at(*i, *j, *k) == region);
        if OWN_WEIGHT + FACE_WEIGHT * same.count() as f64 > 0.5 {
            return false;
        }
        weights.clear();
        self.weights_at_index(DVec3::from(voxel.map(|c| c as f64)), weights);
        let own = weights.iter().find(|w| w.0 == region).map_or(0.0, |w| w.1);
        weights.iter().any(|w| w.0 != region && w.1 >= own)
    }

    /// Adds the smoothed weights at a position in voxels.
    fn weights_at_index(&self, x: DVec3, weights: &mut Vec<(u16, f64)>) {
        let near = x.round();
        let d = x - near;
        let spline = [
            0.5 * (0.5 - d) * (0.5 - d),
            0.75 - d * d,
            0.5 * (0.5 + d) * (0.5 + d),
        ];
        let [i, j, k] = near.to_array().map(|c| c as isize);
        for (dk, wk) in (-1..).zip(spline.map(|w| w.z)) {
            for (dj, wj) in (-1..).zip(spline.map(|w| w.y)) {
                for (di, wi) in (-1..).zip(spline.map(|w| w.x)) {
                    let region = self.at(i + di, j + dj, k + dk);
                    let weight = wi * wj * wk;
                    match weights.iter_mut().find(|w| w.0 == region) {
                        Some(sum) => sum.1 += weight,
                        None => weights.push((region, weight)),
                    }
                }
            }
        }
    }

    /// Counts the boundary faces of the voxels of each region.
    fn boundary_faces(&self) -> Vec<usize> {
        let [nx, ny, nz] = self.size;
        let none = || vec![0usize; self.voxels.len()];
        let outside = vec![0u16; nx];
        let row = |n: usize| &self.regions[n * nx..(n + 1) * nx];
        let counts = parallel::collect(ny * nz, |rows, counts| {
            let mut faces = none();
            let mut between = |a: &[u16], b: &[u16]| {
                // Most rows are equal.
                if a == b {
                    return;
                }
                for (a, b) in a.iter().zip(b).filter(|(a, b)| a != b) {
                    faces[usize::from(*a)] += 1;
                    faces[usize::from(*b)] += 1;
                }
            };
            for n in rows {
                let own = row(n);
                let (j, k) = (n % ny, n / ny);
                between(own, if j > 0 { row(n - 1) } else { &outside });
                between(own, if k > 0 { row(n - ny) } else { &outside });
                if j + 1 == ny {
                    between(own, &outside);
                }
                if k + 1 == nz {
                    between(own, &outside);
                }
                between(&own[1..], &own[..nx - 1]);
                between(&own[..1], &outside[..1]);
                between(&own[nx - 1..], &outside[..1]);
            }
            counts.push(faces);
        });
        counts.into_iter().fold(none(), |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        })
    }

    /// Returns the volume of the voxels of each region, from region 1 on.
    pub fn voxel_volumes(&self) -> Vec<f64> {
        let voxel = self.to_world.matrix3.determinant().abs();
        let counts = self.voxels.iter().skip(1);
        counts.map(|n| *n as f64 * voxel).collect()
    }

    fn at(&self, i: isize, j: isize, k: isize) -> u16 {
        let [nx, ny, nz] = self.size;
        match (usize::try_from(i), usize::try_from(j), usize::try_from(k)) {
            (Ok(i), Ok(j), Ok(k)) if i < nx && j < ny && k < nz => {
                self.regions[i + nx * (j + ny * k)]
            }
            _ => 0,
        }
    }

    fn build_bricks(&mut self) {
        let (mut size, mut below) = (self.size, &self.regions);
        while size.iter().any(|n| *n > 1) {
            let half = size.map(|n| n.div_ceil(2));
            let bricks = parallel::map(half.iter().product(), |b| {
                let at = [b % half[0], b / half[0] % half[1], b / half[0] / half[1]];
                let mut found = None;
                for n in 0..8 {
                    let [i, j, k] = [0, 1, 2].map(|a| 2 * at[a] + (n >> a & 1));
                    if i < size[0] && j < size[1] && k < size[2] {
                        let region = below[i + size[0] * (j + size[1] * k)];
                        if *found.get_or_insert(region) != region {
                            return MIXED_BRICK;
                        }
                    }
                }
                found.unwrap_or(0)
            });
            self.bricks.push((half, bricks));
            size = half;
            below = match self.bricks.last() {
                Some((_, bricks)) => bricks,
                None => break,
            };
        }
    }

    /// Whether all voxels of a brick within `range` belong to the region `found`, which the first
    /// voxel sets.
    fn is_one(
        &self,
        level: usize,
        brick: [usize; 3],
        range: [[usize; 3]; 2],
        found: &mut Option<u16>,
    ) -> bool {
        let (size, regions) = match level {
            0 => (self.size, &self.regions),
            _ => (self.bricks[level - 1].0, &self.bricks[level - 1].1),
        };
        let [i, j, k] = brick;
        let region = regions[i + size[0] * (j + size[1] * k)];
        if region != MIXED_BRICK {
            return *found.get_or_insert(region) == region;
        }
        let below = match level {
            1 => self.size,
            _ => self.bricks[level - 2].0,
        };
        (0..8).all(|n| {
            let child = [0, 1, 2].map(|a| 2 * brick[a] + (n >> a & 1));
            let within = (0..3).all(|a| {
                let first = child[a] << (level - 1);
                let end = (child[a] + 1) << (level - 1);
                child[a] < below[a] && first <= range[1][a] && end > range[0][a]
            });
            !within || self.is_one(level - 1, child, range, found)
        })
    }
}

impl Domain for LabelDomain {
    fn bounds(&self) -> (DVec3, DVec3) {
        let (low, high) = self.extent;
        world_box(&self.to_world, low, high)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let x = self.to_index.transform_point3(p);
        let near = x.round();
        // Everything beyond the volume and one layer of voxels around it is outside.
        let size = DVec3::from(self.size.map(|n| n as f64));
        if !(near.cmpge(DVec3::splat(-2.0)).all() && near.cmple(size + 1.0).all()) {
            weights.push((0, 1.0));
            return;
        }
        self.weights_at_index(x, weights);
        if !self.gains.is_empty() {
            for (region, weight) in weights {
                *weight *= self.gain(usize::from(*region));
            }
        }
    }

    fn volumes(&self) -> Vec<RegionVolume> {
        let voxel = self.to_world.matrix3.determinant().abs();
        let faces = self.boundary_faces().into_iter().skip(1);
        let volumes = self.voxel_volumes().into_iter().zip(faces);
        volumes
            .map(|(volume, faces)| RegionVolume {
                volume,
                area: BOUNDARY_SHIFT_PER_WEIGHT * faces as f64 * voxel,
            })
            .collect()
    }

    fn resolving_edge(&self) -> Option<f64> {
        let m = self.to_world.matrix3;
        let sides = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::length);
        Some(0.5 * sides.into_iter().fold(f64::INFINITY, f64::min))
    }

    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let (low, high) = world_box(&self.to_index, low, high);
        // The voxels that contribute to any weight within the box.
        let first = (low - 1.5).ceil();
        let last = (high + 1.5).floor();
        let end = DVec3::from(self.size.map(|n| n as f64 - 1.0));
        if first.cmpgt(end).any() || last.cmplt(DVec3::ZERO).any() {
            return Some(0);
        }
        let beyond = first.cmplt(DVec3::ZERO).any() || last.cmpgt(end).any();
        let range =
            [first.max(DVec3::ZERO), last.min(end)].map(|c| c.to_array().map(|c| c as usize));
        let widest = (0..3).map(|a| range[1][a] - range[0][a]).max().unwrap_or(0);
        let level = (usize::BITS - widest.leading_zeros()) as usize;
        let level = level.min(self.bricks.len());
        let bricks = range.map(|c| c.map(|c| c >> level));
        let mut found = beyond.then_some(0);
        for k in bricks[0][2]..=bricks[1][2] {
            for j in bricks[0][1]..=bricks[1][1] {
                for i in bricks[0][0]..=bricks[1][0] {
                    if !self.is_one(level, [i, j, k], range, &mut found) {
                        return None;
                    }
                }
            }
        }
        found
    }
}

/// Returns the box half a voxel beyond the voxels of any region; the lower corner is above the
/// upper one if there are none.
fn extent(regions: &[u16], [nx, ny, nz]: [usize; 3]) -> (DVec3, DVec3) {
    let of_row = |row: usize| {
        let voxels = &regions[row * nx..(row + 1) * nx];
        let first = voxels.iter().position(|r| *r != 0)?;
        let last = voxels.iter().rposition(|r| *r != 0)?;
        let (j, k) = ((row % ny) as f64, (row / ny) as f64);
        let low = DVec3::new(first as f64, j, k) - 0.5;
        let high = DVec3::new(last as f64, j, k) + 0.5;
        Some((low, high))
    };
    let boxes = parallel::collect(ny * nz, |rows, boxes| boxes.extend(rows.filter_map(of_row)));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let boxes = boxes.into_iter();
    boxes.fold(none, |a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// Returns the axis-aligned bounding box of the image of a box.
pub(super) fn world_box(map: &DAffine3, low: DVec3, high: DVec3) -> (DVec3, DVec3) {
    let centre = map.transform_point3(0.5 * (low + high));
    let half = 0.5 * (high - low);
    let m = map.matrix3;
    let reach = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
    (centre - reach, centre + reach)
}

/// Formats up to ten labels as text.
fn listed(labels: &[i64]) -> String {
    let first: Vec<String> = labels.iter().take(10).map(i64::to_string).collect();
    let more = if labels.len() > 10 { ", …" } else { "" };
    format!("{}{more}", first.join(", "))
}

/// Returns the labels of a volume except 0, ascending.
fn present(volume: &Volume) -> Result<Vec<i64>> {
    let Some(counts) = volume.labels() else {
        return Err(Error::Input(
            "volume is not a label map: its values are not integers, or it has too many different \
            values; define regions by a threshold"
                .into(),
        ));
    };
    let labels: Vec<i64> = counts.into_keys().filter(|l| *l != 0).collect();
    match labels.is_empty() {
        true => Err(Error::Input("no label to mesh: all voxels are 0".into())),
        false => Ok(labels),
    }
}
