//! Resamples a scan into the deformed body.

use super::voxel_cover::Plane;
use super::{Coverage, Warp};
use crate::mesh::ScalarType;
use crate::volume::{Grid, Raw, Volume};
use crate::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};

/// Options of image warping.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WarpOptions {
    /// The voxels are labels: nearest-neighbour instead of trilinear interpolation.
    pub labels: bool,
    /// Value outside of all tetrahedra, in the scan's physical units; by default the scan's
    /// minimum, or 0 for labels.
    pub background: Option<f64>,
}

/// A scan in the deformed body.
#[derive(Clone, Debug)]
pub struct WarpedImage {
    /// With the number type, scaling and names of the scan.
    pub volume: Volume,
    /// Coverage of its grid by the deformed body.
    pub coverage: Coverage,
}

impl Warp<'_> {
    /// Resamples `scan` in the deformed body on `grid` (that of the scan is [`Volume::grid`]).
    ///
    /// A voxel takes the value at its rest position by trilinear interpolation, rounded and clamped
    /// for integer types; up to half a voxel outside of the outermost centres the position is
    /// clamped to them, further out it takes the background.
    ///
    /// # Errors
    /// [`Error::Input`] if the scan has no voxels, its type cannot store the background, or the
    /// output would be empty: no voxel lies in the body, or none of those that do was in the scan.
    pub fn image(&self, scan: &Volume, grid: &Grid, options: &WarpOptions) -> Result<WarpedImage> {
        let sampler = Sampler::new(scan, grid, options)?;
        let mut raw = sampler.empty_like();
        let mut coverage = Coverage::default();
        let map_direction = self.backward();
        let make = |plane: Plane| (sampler.sample_plane(&plane), plane.coverage);
        map_direction.for_each_plane(grid, make, &mut |((plane, beyond), own)| {
            append(&mut raw, plane);
            coverage.add(Coverage { beyond, ..own });
            Ok(())
        })?;
        coverage.require_any(&map_direction, grid)?;
        coverage.require_scan()?;
        Ok(WarpedImage {
            volume: Volume {
                size: grid.size,
                to_world: grid.to_world,
                raw,
                slope: scan.slope,
                intercept: scan.intercept,
                label_names: scan.label_names.clone(),
                label_colours: scan.label_colours.clone(),
                ..Volume::default()
            },
            coverage,
        })
    }
}

impl Coverage {
    /// Rejects a scan that does not overlap the body.
    pub(super) fn require_scan(&self) -> Result<()> {
        match self.uncovered + self.beyond < self.voxels {
            true => Ok(()),
            false => Err(Error::Input(
                "the body at rest does not overlap the scan; the mesh must be in the scan's world coordinates (RAS, mm)".into(),
            )),
        }
    }
}

/// Samples a scan at the rest positions of voxels.
pub(super) struct Sampler<'a> {
    scan: &'a Volume,
    /// From voxel indices of the grid to those of the scan, for zero displacement.
    from_grid: DAffine3,
    /// From mm to voxels of the scan.
    from_world: DMat3,
    labels: bool,
    /// As a stored value.
    background: f64,
}

impl<'a> Sampler<'a> {
    pub fn new(scan: &'a Volume, grid: &Grid, options: &WarpOptions) -> Result<Sampler<'a>> {
        if scan.raw.len() != scan.voxels() || scan.voxels() == 0 || grid.voxels() == 0 {
            return Err(Error::Input(format!(
                "invalid scan or grid: scan size {:?} with {} values, grid size {:?}; sizes must be ≥ 1 and match the number of values",
                scan.size,
                scan.raw.len(),
                grid.size
            )));
        }
        let to_index = scan.to_world.inverse();
        // For identical grids the mapping is exact: parts that do not move stay unchanged.
        let from_grid = match grid.to_world == scan.to_world {
            true => DAffine3::IDENTITY,
            false => to_index * grid.to_world,
        };
        Ok(Sampler {
            scan,
            from_grid,
            from_world: to_index.matrix3,
            labels: options.labels,
            background: background(scan, options)?,
        })
    }

    /// Returns an empty list of the scan's type.
    pub fn empty_like(&self) -> Raw {
        match self.scan.raw {
            Raw::I8(_) => Raw::I8(Vec::new()),
            Raw::U8(_) => Raw::U8(Vec::new()),
            Raw::I16(_) => Raw::I16(Vec::new()),
            Raw::U16(_) => Raw::U16(Vec::new()),
            Raw::I32(_) => Raw::I32(Vec::new()),
            Raw::U32(_) => Raw::U32(Vec::new()),
            Raw::I64(_) => Raw::I64(Vec::new()),
            Raw::U64(_) => Raw::U64(Vec::new()),
            Raw::F32(_) => Raw::F32(Vec::new()),
            Raw::F64(_) => Raw::F64(Vec::new()),
        }
    }

    /// Returns the voxels of a plane, and the number of those inside a tetrahedron but outside of
    /// the scan.
    pub fn sample_plane(&self, plane: &Plane) -> (Raw, usize) {
        match &self.scan.raw {
            Raw::I8(v) => self.typed(v, plane, Raw::I8),
            Raw::U8(v) => self.typed(v, plane, Raw::U8),
            Raw::I16(v) => self.typed(v, plane, Raw::I16),
            Raw::U16(v) => self.typed(v, plane, Raw::U16),
            Raw::I32(v) => self.typed(v, plane, Raw::I32),
            Raw::U32(v) => self.typed(v, plane, Raw::U32),
            Raw::I64(v) => self.typed(v, plane, Raw::I64),
            Raw::U64(v) => self.typed(v, plane, Raw::U64),
            Raw::F32(v) => self.typed(v, plane, Raw::F32),
            Raw::F64(v) => self.typed(v, plane, Raw::F64),
        }
    }

    fn typed<T: Number>(
        &self,
        scan: &[T],
        plane: &Plane,
        raw: impl Fn(Vec<T>) -> Raw,
    ) -> (Raw, usize) {
        let background = T::nearest(self.background);
        let mut beyond = 0;
        let voxel = |(n, shift): (usize, &DVec3)| {
            if shift.is_nan() {
                return background;
            }
            let [i, j] = [n % plane.width, n / plane.width].map(|x| x as f64);
            let here = DVec3::new(i, j, plane.k as f64);
            let rest = self.from_grid.transform_point3(here) + self.from_world * *shift;
            let value = match self.labels {
                true => nearest(scan, self.scan.size, rest),
                false => trilinear(scan, self.scan.size, rest),
            };
            value.unwrap_or_else(|| {
                beyond += 1;
                background
            })
        };
        let values = plane.displacements.iter().enumerate().map(voxel).collect();
        (raw(values), beyond)
    }
}

/// Returns the background as a stored value of the scan.
fn background(scan: &Volume, options: &WarpOptions) -> Result<f64> {
    let value = match (options.background, options.labels) {
        (Some(value), _) => value,
        (None, true) => 0.0,
        (None, false) => scan.range().map_or(0.0, |(low, _)| low),
    };
    let stored = (value - scan.intercept) / scan.slope;
    let (least, most) = match scan.raw.scalar_type() {
        ScalarType::I8 => (i8::MIN.into(), i8::MAX.into()),
        ScalarType::U8 => (u8::MIN.into(), u8::MAX.into()),
        ScalarType::I16 => (i16::MIN.into(), i16::MAX.into()),
        ScalarType::U16 => (u16::MIN.into(), u16::MAX.into()),
        ScalarType::I32 => (i32::MIN.into(), i32::MAX.into()),
        ScalarType::U32 => (u32::MIN.into(), u32::MAX.into()),
        ScalarType::I64 => (i64::MIN as f64, i64::MAX as f64),
        ScalarType::U64 => (0.0, u64::MAX as f64),
        ScalarType::F32 | ScalarType::F64 => return Ok(stored),
    };
    // Slope and intercept are rounded in some files.
    let whole = stored.round();
    match (least..=most).contains(&whole) && (stored - whole).abs() <= 1e-3 {
        true => Ok(whole),
        false => Err(Error::Input(format!(
            "background {value} cannot be stored: the scan holds integers from {least} to {most} (slope {}, intercept {}); change --background",
            scan.slope, scan.intercept
        ))),
    }
}

/// A number type of scans.
trait Number: Copy {
    fn wide(self) -> f64;
    /// Rounds and clamps to the range of the type.
    fn nearest(value: f64) -> Self;
}

macro_rules! numbers {
    ($($whole:ty)*; $($real:ty)*) => {
        $(impl Number for $whole {
            fn wide(self) -> f64 {
                self as f64
            }
            fn nearest(value: f64) -> Self {
                value.round() as $whole
            }
        })*
        $(impl Number for $real {
            fn wide(self) -> f64 {
                self.into()
            }
            fn nearest(value: f64) -> Self {
                value as $real
            }
        })*
    };
}
numbers!(i8 u8 i16 u16 i32 u32 i64 u64; f32 f64);

/// Clamps voxel coordinates `x` to the outermost centres; `None` if more than half a voxel outside.
fn kept_within(size: [usize; 3], x: DVec3) -> Option<DVec3> {
    let last = DVec3::from(size.map(|n| n as f64 - 1.0));
    let within = x.cmpge(DVec3::splat(-0.5)).all() && x.cmple(last + 0.5).all();
    within.then(|| x.clamp(DVec3::ZERO, last))
}

fn nearest<T: Number>(scan: &[T], size: [usize; 3], x: DVec3) -> Option<T> {
    let [i, j, k] = (kept_within(size, x)? + 0.5).floor().to_array();
    let [i, j, k] = [i as usize, j as usize, k as usize];
    // Half a voxel past the last centre still belongs to the last voxel.
    let [i, j, k] = [i.min(size[0] - 1), j.min(size[1] - 1), k.min(size[2] - 1)];
    Some(scan[i + size[0] * (j + size[1] * k)])
}

fn trilinear<T: Number>(scan: &[T], size: [usize; 3], x: DVec3) -> Option<T> {
    let x = kept_within(size, x)?;
    let below = x.floor();
    let part = x - below;
    let [i, j, k] = below.to_array().map(|b| b as usize);
    let first = i + size[0] * (j + size[1] * k);
    if part == DVec3::ZERO {
        // Exact, also for integers that float64 cannot represent.
        return Some(scan[first]);
    }
    // Step along an axis; none from the last voxel, where the weight is 0.
    let step = |axis: usize, stride: usize| if part[axis] > 0.0 { stride } else { 0 };
    let [x, y, z] = [step(0, 1), step(1, size[0]), step(2, size[0] * size[1])];
    let line = |n: usize| mix(scan[n].wide(), scan[n + x].wide(), part.x);
    let face = |n: usize| mix(line(n), line(n + y), part.y);
    Some(T::nearest(mix(face(first), face(first + z), part.z)))
}

/// Interpolates between `a` and `b`; ignores `b` if its weight is 0.
fn mix(a: f64, b: f64, share: f64) -> f64 {
    match share == 0.0 || a == b {
        true => a,
        false => a + share * (b - a),
    }
}

/// Appends the numbers of `more`, which has the same type.
fn append(all: &mut Raw, more: Raw) {
    match (all, more) {
        (Raw::I8(a), Raw::I8(b)) => a.extend(b),
        (Raw::U8(a), Raw::U8(b)) => a.extend(b),
        (Raw::I16(a), Raw::I16(b)) => a.extend(b),
        (Raw::U16(a), Raw::U16(b)) => a.extend(b),
        (Raw::I32(a), Raw::I32(b)) => a.extend(b),
        (Raw::U32(a), Raw::U32(b)) => a.extend(b),
        (Raw::I64(a), Raw::I64(b)) => a.extend(b),
        (Raw::U64(a), Raw::U64(b)) => a.extend(b),
        (Raw::F32(a), Raw::F32(b)) => a.extend(b),
        (Raw::F64(a), Raw::F64(b)) => a.extend(b),
        _ => {}
    }
}
