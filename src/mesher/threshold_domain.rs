//! Ranges of the values of a volume as a domain.

use super::label_domain::world_box;
use super::{Domain, ThresholdRange};
use crate::parallel;
use crate::volume::Volume;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};

/// Side, in voxels, of a brick of the min-max pyramid.
const BRICK: usize = 4;

/// The parts of a volume whose values, trilinear between voxel centres, lie in a range: region 1
/// for the first range, and so on. Everything beyond the volume is outside.
///
/// Non-finite values count as outside. Where ranges overlap, a point belongs to the one it lies
/// deeper in.
#[derive(Debug)]
pub struct ThresholdDomain<'a> {
    volume: &'a Volume,
    windows: Vec<[f64; 2]>,
    /// Minimum and maximum in bricks of voxels, including the adjacent voxels.
    bricks: Vec<[f64; 2]>,
    brick_size: [usize; 3],
    /// Minimum and maximum of the volume.
    range: [f64; 2],
    to_index: DAffine3,
    extent: (DVec3, DVec3),
}

impl<'a> ThresholdDomain<'a> {
    /// Creates the regions of `volume` whose values lie in `windows`.
    ///
    /// # Errors
    /// An error for a range without voxels, for no range, and for a volume without an extent or a
    /// finite value.
    pub fn new(volume: &'a Volume, windows: &[ThresholdRange]) -> Result<ThresholdDomain<'a>> {
        let to_index = volume.to_world.inverse();
        if !to_index.is_finite() {
            return Err(Error::Input(
                "cannot mesh a degenerate volume: its axes are linearly dependent".into(),
            ));
        }
        let Some((lowest, highest)) = volume.range() else {
            return Err(Error::Input(
                "nothing to mesh: volume has no finite values".into(),
            ));
        };
        if windows.is_empty() || windows.len() >= usize::from(u16::MAX) {
            return Err(Error::Input(format!(
                "number of thresholds must be 1 to 65534, got {}",
                windows.len()
            )));
        }
        let mut domain = ThresholdDomain {
            volume,
            windows: windows.iter().map(|w| [w.low, w.high]).collect(),
            bricks: Vec::new(),
            brick_size: volume.size.map(|n| n.div_ceil(BRICK)),
            range: [lowest, highest],
            to_index,
            extent: (DVec3::INFINITY, DVec3::NEG_INFINITY),
        };
        for window in &domain.windows {
            let within = |n| (window[0]..=window[1]).contains(&domain.value(n));
            let found = parallel::collect(volume.voxels(), |mut range, found| {
                found.extend(range.find(|n| within(*n)));
            });
            if found.is_empty() {
                return Err(Error::Input(format!(
                    "no voxel has a value from {} to {}; values range from {lowest} to {highest}",
                    window[0], window[1]
                )));
            }
        }
        domain.extent = domain.find_extent();
        let bricks = domain.brick_size.iter().product();
        domain.bricks = parallel::map(bricks, |b| domain.range_of_brick(b));
        Ok(domain)
    }

    /// Returns the value of a voxel; a non-finite one is less than all others.
    fn value(&self, n: usize) -> f64 {
        let value = self.volume.value(n);
        match value.is_finite() {
            true => value,
            false => self.range[0] - (self.range[1] - self.range[0]) - 1.0,
        }
    }

    fn voxel(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.volume.size[0] * (j + self.volume.size[1] * k)
    }

    fn range_of_brick(&self, b: usize) -> [f64; 2] {
        let [nx, ny, _] = self.brick_size;
        let brick = [b % nx, b / nx % ny, b / nx / ny];
        let first = brick.map(|c| c * BRICK);
        let end = [0, 1, 2].map(|a| (first[a] + BRICK + 1).min(self.volume.size[a]));
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for k in first[2]..end[2] {
            for j in first[1]..end[1] {
                for i in first[0]..end[0] {
                    let value = self.value(self.voxel([i, j, k]));
                    range = [range[0].min(value), range[1].max(value)];
                }
            }
        }
        range
    }

    /// Returns the bounding box of all regions, in voxels.
    fn find_extent(&self) -> (DVec3, DVec3) {
        let [nx, ny, _] = self.volume.size;
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let last = DVec3::from(self.volume.size.map(|n| n as f64)) - 0.5;
        let both = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let boxes = parallel::collect(self.volume.voxels(), |range, boxes| {
            let inside = range.filter(|n| {
                let value = self.value(*n);
                self.windows.iter().any(|w| (w[0]..=w[1]).contains(&value))
            });
            let points = inside.map(|n| {
                let at = DVec3::from([n % nx, n / nx % ny, n / nx / ny].map(|c| c as f64));
                (at, at)
            });
            boxes.extend(points.reduce(both));
        });
        let (low, high) = boxes.into_iter().fold(none, both);
        // Between voxels, values within a range may be up to one voxel away from any that is
        // inside.
        ((low - 1.0).max(DVec3::splat(-0.5)), (high + 1.0).min(last))
    }

    /// Returns the trilinear value at voxel coordinates, clamped to the border.
    fn at(&self, x: DVec3) -> f64 {
        let size = self.volume.size;
        let x = x.clamp(DVec3::ZERO, DVec3::from(size.map(|n| n as f64 - 1.0)));
        let below = x.floor();
        let part = x - below;
        let low = below.to_array().map(|b| b as usize);
        let high = [0, 1, 2].map(|a| (low[a] + 1).min(size[a] - 1));
        let along = |j: usize, k: usize| {
            let first = self.value(self.voxel([low[0], j, k]));
            let second = self.value(self.voxel([high[0], j, k]));
            first + part.x * (second - first)
        };
        let plane = |k: usize| {
            let (first, second) = (along(low[1], k), along(high[1], k));
            first + part.y * (second - first)
        };
        let (first, second) = (plane(low[2]), plane(high[2]));
        first + part.z * (second - first)
    }
}

impl Domain for ThresholdDomain<'_> {
    fn bounds(&self) -> (DVec3, DVec3) {
        world_box(&self.volume.to_world, self.extent.0, self.extent.1)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let x = self.to_index.transform_point3(p);
        let value = self.at(x);
        // The volume ends half a voxel beyond the outermost centres: towards there, weights
        // decrease by the whole range of values per voxel.
        let last = DVec3::from(self.volume.size.map(|n| n as f64)) - 0.5;
        let depth = (x + 0.5).min(last - x).min_element();
        let end = depth * (self.range[1] - self.range[0]).max(f64::MIN_POSITIVE);
        for (region, [low, high]) in (1..).zip(&self.windows) {
            weights.push((region, (value - low).min(high - value).min(end)));
        }
    }

    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let (low, high) = world_box(&self.to_index, low, high);
        let size = self.volume.size;
        let last = DVec3::from(size.map(|n| n as f64)) - 0.5;
        if low.cmpgt(last).any() || high.cmplt(DVec3::splat(-0.5)).any() {
            return Some(0);
        }
        let end = DVec3::from(size.map(|n| n as f64 - 1.0));
        let brick = |p: DVec3| {
            let voxel = p.clamp(DVec3::ZERO, end).to_array();
            voxel.map(|c| c as usize / BRICK)
        };
        let (first, final_brick) = (brick(low), brick(high));
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        let mut region = None;
        for k in first[2]..=final_brick[2] {
            for j in first[1]..=final_brick[1] {
                for i in first[0]..=final_brick[0] {
                    let b = i + self.brick_size[0] * (j + self.brick_size[1] * k);
                    let [least, most] = self.bricks[b];
                    range = [range[0].min(least), range[1].max(most)];
                    region = self.region_of(range);
                    region?;
                }
            }
        }
        // Near the border the volume has an outside, too, and the weights are not those of the
        // values.
        let inside = low.cmpgt(DVec3::splat(0.5)).all() && high.cmplt(last - 1.0).all();
        region.filter(|r| inside || *r == 0)
    }
}

impl ThresholdDomain<'_> {
    /// Returns the single region of values within `range`.
    fn region_of(&self, [least, most]: [f64; 2]) -> Option<u16> {
        let apart = |w: &[f64; 2]| most < w[0] || least > w[1];
        let mut inside = (1u16..).zip(&self.windows).filter(|(_, w)| !apart(w));
        match (inside.next(), inside.next()) {
            (None, _) => Some(0),
            (Some((region, w)), None) if least > w[0] && most < w[1] => Some(region),
            _ => None,
        }
    }
}
