//! Reader for NIfTI-1 and NIfTI-2: .nii, .nii.gz, and .hdr with .img.
//!
//! The format is described at nifti.nimh.nih.gov; its world is RAS.

use super::Fetch;
use super::voxels::{Packing, bytes_in, decode, extent, unpack};
use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use crate::volume::Volume;
use flate2::read::MultiGzDecoder;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::collections::BTreeMap;
use std::io::Read;

const GZIP: [u8; 2] = [0x1f, 0x8b];
/// Sizes of the headers of versions 1 and 2, which are also their first number.
const LENGTHS: [usize; 2] = [348, 540];

/// Returns the start of the file, decompressed; at most the size of a header.
fn beginning(file: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let limit = LENGTHS[1] as u64;
    // A failed decompression gives an empty, unrecognised start.
    let _ = match file.starts_with(&GZIP) {
        true => MultiGzDecoder::new(file)
            .take(limit)
            .read_to_end(&mut bytes),
        false => file.take(limit).read_to_end(&mut bytes),
    };
    bytes
}

/// Whether a file begins as a NIfTI file.
pub(super) fn is_nifti(file: &[u8]) -> bool {
    Header::new(&beginning(file)).is_some()
}

/// A header of either version and byte order.
struct Header<'a> {
    bytes: &'a [u8],
    second: bool,
    big_endian: bool,
    /// Whether the voxels are in a separate file.
    pair: bool,
}

/// Parses the bytes of `file` as a volume.
pub(super) fn read(file: &[u8], fetch: Fetch) -> ParseResult<Volume> {
    let start = beginning(file);
    let header = Header::new(&start).ok_or("expected a NIfTI header at the start of the file")?;
    let size = header.size()?;
    let scalar = header.scalar_type()?;
    let (_, bytes) = extent(size, scalar)?;
    let offset = header.offset()?;
    let other;
    let (data, offset) = if header.pair {
        other = fetch("*.img").or_else(|_| fetch("*.img.gz"))?;
        (other.as_slice(), offset)
    } else {
        let least = LENGTHS[usize::from(header.second)];
        // Some writers leave the offset at 0 in a single file.
        (file, if offset == 0 { least + 4 } else { offset })
    };
    if !header.pair && offset < LENGTHS[usize::from(header.second)] {
        return Err(format!(
            "`vox_offset` is {offset}, expected a position after the header"
        ));
    }
    let wanted = offset
        .checked_add(bytes)
        .ok_or("`vox_offset` is larger than any file")?;
    let packing = match data.starts_with(&GZIP) {
        true => Packing::Gzip,
        false => Packing::Raw,
    };
    let unpacked = unpack(data, packing, wanted)?;
    let (slope, intercept) = header.scaling();
    Ok(Volume {
        size,
        raw: decode(&unpacked[offset..], scalar, header.big_endian),
        slope,
        intercept,
        to_world: header.to_world()?,
        label_names: BTreeMap::new(),
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
                let pair = match magic {
                    b"n+1\0" | b"n+2\0" => false,
                    b"ni1\0" | b"ni2\0" => true,
                    _ => return None,
                };
                return Some(Header {
                    bytes,
                    second,
                    big_endian,
                    pair,
                });
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

    fn size(&self) -> ParseResult<[usize; 3]> {
        let dim = |n: usize| match self.second {
            false => self.i16(40 + 2 * n),
            true => self.i64(16 + 8 * n),
        };
        let axes = dim(0);
        if !(1..=7).contains(&axes) {
            return Err(format!("`dim[0]` must be 1 to 7 axes, got {axes}"));
        }
        let axes = axes as usize;
        let sizes: Vec<i64> = (1..=axes).map(dim).collect();
        if sizes.iter().any(|n| *n < 1) {
            return Err(format!("`dim` must be integers ≥ 1, got {sizes:?}"));
        }
        if axes < 3 || sizes[3..].iter().any(|n| *n != 1) {
            return Err(format!(
                "sizes {sizes:?} are not a single volume; expected three axes (extract one volume \
                of a series first)"
            ));
        }
        let size = |n: usize| usize::try_from(sizes[n]).map_err(|_| "`dim` is too large");
        Ok([size(0)?, size(1)?, size(2)?])
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

    /// Returns the sform if present, otherwise the qform, otherwise the spacing alone.
    fn to_world(&self) -> ParseResult<DAffine3> {
        let spacing = |n: usize| self.real([76, 104], n);
        let spacings = DVec3::new(spacing(1), spacing(2), spacing(3)).abs();
        let sized = spacings.cmpgt(DVec3::ZERO).all() && spacings.is_finite();
        let (name, affine) = if self.code([254, 348]) > 0 {
            let row = |r: usize, n: usize| self.real([280 + 16 * r, 400 + 32 * r], n);
            let column = |n: usize| DVec3::new(row(0, n), row(1, n), row(2, n));
            let linear = DMat3::from_cols(column(0), column(1), column(2));
            ("sform", DAffine3::from_mat3_translation(linear, column(3)))
        } else if self.code([252, 344]) > 0 {
            let part = |n: usize| self.real([256, 352], n);
            let imaginary = DVec3::new(part(0), part(1), part(2));
            let real = (1.0 - imaginary.length_squared()).max(0.0).sqrt();
            let [b, c, d] = imaginary.to_array();
            let turn = DMat3::from_quat(DQuat::from_xyzw(b, c, d, real).normalize());
            // The handedness is stored in the sign of the first spacing.
            let hand = if spacing(0) < 0.0 { -1.0 } else { 1.0 };
            let scaled = DMat3::from_diagonal(spacings * DVec3::new(1.0, 1.0, hand));
            let offset = DVec3::new(part(3), part(4), part(5));
            (
                "qform",
                DAffine3::from_mat3_translation(turn * scaled, offset),
            )
        } else {
            let scaled = DMat3::from_diagonal(if sized { spacings } else { DVec3::ONE });
            ("pixdim", DAffine3::from_mat3(scaled))
        };
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
}
