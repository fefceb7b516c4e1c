//! Reader for NIfTI-1 and NIfTI-2, and for Analyze 7.5: .nii, .nii.gz, and .hdr with .img.
//!
//! The format is described at nifti.nimh.nih.gov; its world is RAS.

use super::voxels::{Packing, bytes_in, chosen, decode, extent, unpack, unpack_start};
use super::{Fetch, analyze};
use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use crate::volume::Volume;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// Sizes of the headers of versions 1 and 2, which are also their first number.
const LENGTHS: [usize; 2] = [348, 540];

/// Whether a decompressed file begins as a NIfTI or Analyze file.
pub(super) fn is_nifti(start: &[u8]) -> bool {
    Header::new(start).is_some()
}

/// Where the voxels are.
#[derive(Clone, Copy, PartialEq)]
enum Layout {
    /// In the same file.
    Single,
    /// In the .img in the folder of the .hdr.
    Pair,
    /// The same, of an Analyze image.
    Analyze,
}

/// A header of either version and byte order.
struct Header<'a> {
    bytes: &'a [u8],
    second: bool,
    big_endian: bool,
    layout: Layout,
}

/// Parses the bytes of `file` as a volume: number `number` of several.
pub(super) fn read(file: &[u8], fetch: Fetch, number: Option<usize>) -> ParseResult<Volume> {
    let start = Packing::of(file).take(file, LENGTHS[1] as u64);
    let start = start.unwrap_or_default();
    let header = Header::new(&start).ok_or("expected a NIfTI header at the start of the file")?;
    let mut notes = Vec::new();
    let (size, count) = header.size(&mut notes)?;
    let number = chosen(number, count, "`dim`")?;
    let scalar = header.scalar_type()?;
    let (_, bytes) = extent(size, scalar)?;
    let offset = header.offset()?;
    let other;
    let least = LENGTHS[usize::from(header.second)];
    let (data, offset) = match header.layout {
        // Some writers leave the offset at 0 in a single file.
        Layout::Single if offset == 0 => (file, least + 4),
        Layout::Single => (file, offset),
        _ => {
            other = voxels_beside(file, fetch)?;
            (other.as_slice(), offset)
        }
    };
    if header.layout == Layout::Single && offset < least {
        return Err(format!(
            "`vox_offset` is {offset}, expected a position after the header"
        ));
    }
    let first = number
        .checked_mul(bytes)
        .and_then(|n| n.checked_add(offset));
    let range = first.and_then(|first| Some(first..first.checked_add(bytes)?));
    let range = range.ok_or("`vox_offset` is larger than any file")?;
    let packing = Packing::of(data);
    let unpacked = match number + 1 == count {
        true => unpack(data, packing, [range.end, bytes], &mut notes)?,
        false => unpack_start(data, packing, range.end)?,
    };
    let (slope, intercept) = header.scaling();
    if header.layout == Layout::Analyze && fetch("*.mat").is_ok() {
        notes.push(
            "the .mat of SPM in the folder of the header, with the position, is not read".into(),
        );
    }
    Ok(Volume {
        size,
        raw: decode(&unpacked[range], scalar, header.big_endian),
        slope,
        intercept,
        to_world: match header.layout {
            Layout::Analyze => header.analyze_to_world(size, &mut notes)?,
            _ => header.to_world(&mut notes)?,
        },
        notes,
        ..Volume::default()
    })
}

/// Reads the voxels of a pair: compressed as the header is, if there are both.
fn voxels_beside(header: &[u8], fetch: Fetch) -> ParseResult<Vec<u8>> {
    let names = match Packing::of(header) {
        Packing::Raw => ["*.img", "*.img.gz", "*.IMG"],
        _ => ["*.img.gz", "*.img", "*.IMG"],
    };
    fetch(names[0]).or_else(|first| {
        let other = fetch(names[1]);
        other.or_else(|second| fetch(names[2]).map_err(|_| format!("{first}; {second}")))
    })
}

impl<'a> Header<'a> {
    fn new(bytes: &'a [u8]) -> Option<Header<'a>> {
        let length: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
        let is = |n: usize, big: bool| {
            let read = if big {
                u32::from_be_bytes(length)
            } else {
                u32::from_le_bytes(length)
            };
            read as usize == n && bytes.len() >= n
        };
        for second in [false, true] {
            for big_endian in [false, true] {
                if !is(LENGTHS[usize::from(second)], big_endian) {
                    continue;
                }
                let magic = if second {
                    bytes.get(4..8)?
                } else {
                    bytes.get(344..348)?
                };
                let layout = match magic {
                    b"n+1\0" | b"n+2\0" => Layout::Single,
                    b"ni1\0" | b"ni2\0" => Layout::Pair,
                    // The axes of an Analyze image are counted in the same place.
                    _ if !second => Layout::Analyze,
                    _ => return None,
                };
                let header = Header {
                    bytes,
                    second,
                    big_endian,
                    layout,
                };
                let sound = layout != Layout::Analyze || (1..=7).contains(&header.i16(40));
                return sound.then_some(header);
            }
        }
        None
    }

    /// Returns the bytes of a number; zeros past the end of a shorter header.
    fn at<const N: usize>(&self, place: usize) -> [u8; N] {
        let mut number = [0; N];
        if let Some(bytes) = self.bytes.get(place..place + N) {
            number.copy_from_slice(bytes);
        }
        if self.big_endian {
            number.reverse();
        }
        number
    }

    fn i16(&self, place: usize) -> i64 {
        i16::from_le_bytes(self.at(place)).into()
    }

    fn i64(&self, place: usize) -> i64 {
        i64::from_le_bytes(self.at(place))
    }

    /// Returns entry `n` of an array of reals: single precision in version 1, double in version 2.
    fn real(&self, [first, second]: [usize; 2], n: usize) -> f64 {
        match self.second {
            false => f32::from_le_bytes(self.at(first + 4 * n)).into(),
            true => f64::from_le_bytes(self.at(second + 8 * n)),
        }
    }

    /// Returns a code: 16 bits in version 1, 32 in version 2.
    fn code(&self, [first, second]: [usize; 2]) -> i64 {
        match self.second {
            false => self.i16(first),
            true => i32::from_le_bytes(self.at(second)).into(),
        }
    }

    /// Returns the size of each volume and their number.
    fn size(&self, notes: &mut Vec<String>) -> ParseResult<([usize; 3], usize)> {
        let dim = |n: usize| match self.second {
            false => self.i16(40 + 2 * n),
            true => self.i64(16 + 8 * n),
        };
        let axes = dim(0);
        if !(1..=7).contains(&axes) {
            return Err(format!("`dim[0]` must be 1 to 7 axes, got {axes}"));
        }
        let axes = axes as usize;
        let mut sizes: Vec<i64> = (1..=axes).map(dim).collect();
        for (n, size) in sizes.iter_mut().enumerate().skip(3) {
            if *size == 0 {
                notes.push(format!("`dim[{}]` is 0 and was taken for 1", n + 1));
                *size = 1;
            }
        }
        if sizes.iter().any(|n| *n < 1) {
            return Err(format!("`dim` must be integers ≥ 1, got {sizes:?}"));
        }
        if axes < 3 {
            return Err(format!(
                "sizes {sizes:?} are no volume; expected three axes"
            ));
        }
        let size = |n: i64| usize::try_from(n).map_err(|_| "`dim` is too large".to_owned());
        let mut count = 1usize;
        for more in &sizes[3..] {
            let product = count.checked_mul(size(*more)?);
            count = product.ok_or("`dim` is too large")?;
        }
        Ok(([size(sizes[0])?, size(sizes[1])?, size(sizes[2])?], count))
    }

    fn scalar_type(&self) -> ParseResult<ScalarType> {
        let code = self.i16(if self.second { 12 } else { 70 });
        let scalar = match code {
            2 => ScalarType::U8,
            4 => ScalarType::I16,
            8 => ScalarType::I32,
            16 => ScalarType::F32,
            64 => ScalarType::F64,
            256 => ScalarType::I8,
            512 => ScalarType::U16,
            768 => ScalarType::U32,
            1024 => ScalarType::I64,
            1280 => ScalarType::U64,
            _ if self.layout == Layout::Analyze && analyze::scalar_type(code).is_some() => {
                analyze::scalar_type(code).unwrap_or(ScalarType::I8)
            }
            _ => {
                let what = match code {
                    1 => " (bits)",
                    32 | 1792 | 2048 => " (complex numbers)",
                    128 | 2304 => " (colours)",
                    1536 => " (128-bit numbers)",
                    _ => "",
                };
                return Err(format!(
                    "`datatype` {code}{what} is not supported; use integers of 8 to 64 bits, float \
                    or double"
                ));
            }
        };
        let bits = self.i16(if self.second { 14 } else { 72 });
        // Some writers leave it at 0.
        if bits != 0 && bits != 8 * bytes_in(scalar) as i64 {
            return Err(format!(
                "`bitpix` is {bits}, but numbers of `datatype` {code} have {} bits",
                8 * bytes_in(scalar)
            ));
        }
        Ok(scalar)
    }

    fn offset(&self) -> ParseResult<usize> {
        let offset = match self.second {
            false => self.real([108, 0], 0),
            true => self.i64(168) as f64,
        };
        match (0.0..1e12).contains(&offset) && offset.fract() == 0.0 {
            true => Ok(offset as usize),
            false => Err(format!(
                "`vox_offset` must be a non-negative integer below 1e12, got {offset}"
            )),
        }
    }

    /// Returns slope and intercept; a slope of 0 means no scaling.
    fn scaling(&self) -> (f64, f64) {
        let slope = self.real([112, 176], 0);
        let intercept = self.real([116, 184], 0);
        match slope != 0.0 && slope.is_finite() && intercept.is_finite() {
            true => (slope, intercept),
            false => (1.0, 0.0),
        }
    }

    /// Returns the header's unit of length in millimetres.
    fn unit(&self) -> f64 {
        let code = match self.second {
            false => i64::from(self.bytes.get(123).copied().unwrap_or(0)),
            true => i32::from_le_bytes(self.at(500)).into(),
        };
        match code & 7 {
            1 => 1e3,
            3 => 1e-3,
            // Millimetres, or unspecified.
            _ => 1.0,
        }
    }

    /// Returns the spacings in the header's unit; those that are 0 as 1, with a note.
    fn spacings(&self, notes: &mut Vec<String>) -> DVec3 {
        let mut spacings = DVec3::from([1, 2, 3].map(|n| self.real([76, 104], n))).abs();
        for n in 0..3 {
            if spacings[n] == 0.0 {
                notes.push(format!("`pixdim[{}]` is 0 and was taken for 1", n + 1));
                spacings[n] = 1.0;
            }
        }
        spacings
    }

    /// Returns the rows of the sform.
    fn sform(&self) -> DAffine3 {
        let row = |r: usize, n: usize| self.real([280 + 16 * r, 400 + 32 * r], n);
        let column = |n: usize| DVec3::new(row(0, n), row(1, n), row(2, n));
        let linear = DMat3::from_cols(column(0), column(1), column(2));
        DAffine3::from_mat3_translation(linear, column(3))
    }

    /// Returns the rotation, position and `spacings` of the qform.
    fn qform(&self, spacings: DVec3) -> DAffine3 {
        let part = |n: usize| self.real([256, 352], n);
        let imaginary = DVec3::new(part(0), part(1), part(2));
        let real = (1.0 - imaginary.length_squared()).max(0.0).sqrt();
        let [b, c, d] = imaginary.to_array();
        let turn = DMat3::from_quat(DQuat::from_xyzw(b, c, d, real).normalize());
        // The handedness is stored in the sign of the first spacing.
        let hand = if self.real([76, 104], 0) < 0.0 {
            -1.0
        } else {
            1.0
        };
        let scaled = DMat3::from_diagonal(spacings * DVec3::new(1.0, 1.0, hand));
        let offset = DVec3::new(part(3), part(4), part(5));
        DAffine3::from_mat3_translation(turn * scaled, offset)
    }

    /// Returns the sform if present, otherwise the qform, otherwise the spacing alone.
    fn to_world(&self, notes: &mut Vec<String>) -> ParseResult<DAffine3> {
        let in_sform = self.code([254, 348]) > 0;
        let in_qform = self.code([252, 344]) > 0;
        let sform = self.sform();
        // Zeros are a code that was set without its matrix.
        let empty = in_sform && sform.matrix3 == DMat3::ZERO;
        let flat = sform.matrix3.determinant() == 0.0;
        let unusable = empty || (in_sform && in_qform && flat);
        let (name, affine) = if in_sform && !unusable {
            ("sform", sform)
        } else {
            let spacings = self.spacings(notes);
            match in_qform {
                true => ("qform", self.qform(spacings)),
                false => (
                    "pixdim",
                    DAffine3::from_mat3(DMat3::from_diagonal(spacings)),
                ),
            }
        };
        if unusable {
            notes.push(format!(
                "the sform has voxels of zero volume; the {name} was used instead{}",
                match in_qform {
                    true => "",
                    false => ", which states no position and no sides",
                }
            ));
        }
        self.in_millimetres(name, affine)
    }

    /// Converts the map to the world from the header's unit.
    fn in_millimetres(&self, name: &str, affine: DAffine3) -> ParseResult<DAffine3> {
        let unit = self.unit();
        let linear = affine.matrix3 * unit;
        let whole = linear.determinant() != 0.0 && linear.is_finite();
        match whole && affine.translation.is_finite() {
            true => Ok(DAffine3::from_mat3_translation(
                linear,
                affine.translation * unit,
            )),
            false => Err(format!(
                "voxels have zero volume; check the {name} of the header"
            )),
        }
    }

    /// Returns the world of an Analyze image.
    fn analyze_to_world(&self, size: [usize; 3], notes: &mut Vec<String>) -> ParseResult<DAffine3> {
        let orient = self.bytes.get(252).copied().unwrap_or(0);
        let origin = [0, 1, 2].map(|n| self.i16(253 + 2 * n));
        let spacings = self.spacings(notes);
        let world = analyze::to_world(orient, origin, size, spacings, notes)?;
        match world.is_finite() && world.matrix3.determinant() != 0.0 {
            true => Ok(world),
            false => Err("voxels have zero volume; check `pixdim` of the header".into()),
        }
    }
}
