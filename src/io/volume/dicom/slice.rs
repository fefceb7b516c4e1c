//! A slice of a volume in a DICOM file.

use super::element_scan;
use crate::io::cursor::ParseResult;
use crate::io::volume::voxels::decode;
use crate::mesh::ScalarType;
use crate::volume::Raw;
use dicom_object::{DefaultDicomObject, OpenFileOptions, Tag};
use glam::{DVec2, DVec3};
use std::str::FromStr;

const SLICE_THICKNESS: Tag = Tag(0x0018, 0x0050);
const SERIES: Tag = Tag(0x0020, 0x000e);
const POSITION: Tag = Tag(0x0020, 0x0032);
const ORIENTATION: Tag = Tag(0x0020, 0x0037);
const SAMPLES: Tag = Tag(0x0028, 0x0002);
const PHOTOMETRIC: Tag = Tag(0x0028, 0x0004);
const FRAMES: Tag = Tag(0x0028, 0x0008);
const ROWS: Tag = Tag(0x0028, 0x0010);
const COLUMNS: Tag = Tag(0x0028, 0x0011);
const SPACING: Tag = Tag(0x0028, 0x0030);
const BITS: Tag = Tag(0x0028, 0x0100);
const BITS_STORED: Tag = Tag(0x0028, 0x0101);
const HIGH_BIT: Tag = Tag(0x0028, 0x0102);
const SIGNED: Tag = Tag(0x0028, 0x0103);
const INTERCEPT: Tag = Tag(0x0028, 0x1052);
const SLOPE: Tag = Tag(0x0028, 0x1053);
const PIXELS: Tag = Tag(0x7fe0, 0x0010);

const WANTED: [Tag; 17] = [
    SLICE_THICKNESS,
    SERIES,
    POSITION,
    ORIENTATION,
    SAMPLES,
    PHOTOMETRIC,
    FRAMES,
    ROWS,
    COLUMNS,
    SPACING,
    BITS,
    BITS_STORED,
    HIGH_BIT,
    SIGNED,
    INTERCEPT,
    SLOPE,
    PIXELS,
];

/// The transfer syntaxes with uncompressed pixels.
const NATIVE: [&str; 3] = [
    "1.2.840.10008.1.2",
    "1.2.840.10008.1.2.1",
    "1.2.840.10008.1.2.2",
];
const RUN_LENGTH: &str = "1.2.840.10008.1.2.5";

/// A parsed file with an image in it.
pub(super) struct Image {
    object: DefaultDicomObject,
    syntax: String,
    /// Its series.
    pub series: String,
}

/// The image as a slice in space, in the patient's frame: LPS, mm.
pub(super) struct Slice {
    pub columns: usize,
    pub rows: usize,
    /// Position of the centre of the first pixel.
    pub position: DVec3,
    /// Directions of increasing column and row index.
    pub axes: [DVec3; 2],
    /// Distance between columns, and between rows.
    pub spacing: DVec2,
    /// The thickness, if stored.
    pub thickness: Option<f64>,
    pub scaling: [f64; 2],
    pub raw: Raw,
}

impl Image {
    /// Parses the image in a file; `None` if the file is not DICOM, or contains no image.
    pub fn parse(file: &[u8]) -> ParseResult<Option<Image>> {
        if file.get(128..132) != Some(b"DICM") {
            return Ok(None);
        }
        let (syntax, sifted) = element_scan::extract_elements(file, &WANTED)?;
        let object = OpenFileOptions::new()
            .from_reader(sifted.as_slice())
            .map_err(|e| format!("invalid DICOM: {e}"))?;
        if object.get(PIXELS).is_none() {
            return Ok(None);
        }
        let mut image = Image {
            object,
            syntax,
            series: String::new(),
        };
        image.series = image.text(SERIES, "SeriesInstanceUID")?;
        Ok(Some(image))
    }

    fn text(&self, tag: Tag, name: &str) -> ParseResult<String> {
        let element = self.object.get(tag).ok_or_else(|| missing(name))?;
        let text = element.to_str().map_err(|e| format!("`{name}`: {e}"))?;
        Ok(text.trim_matches(['\0', ' ']).to_owned())
    }

    /// Returns the number `name`, if it is present.
    fn one<T: FromStr>(&self, tag: Tag, name: &str) -> ParseResult<Option<T>> {
        let Some(element) = self.object.get(tag) else {
            return Ok(None);
        };
        let text = element.to_str().map_err(|e| format!("`{name}`: {e}"))?;
        let text = text.trim_matches(['\0', ' ']);
        match text.parse() {
            Ok(number) => Ok(Some(number)),
            Err(_) if text.is_empty() => Ok(None),
            Err(_) => Err(format!("`{name}` must be a number, got \"{text}\"")),
        }
    }

    fn required<T: FromStr>(&self, tag: Tag, name: &str) -> ParseResult<T> {
        self.one(tag, name)?.ok_or_else(|| missing(name))
    }

    fn reals<const N: usize>(&self, tag: Tag, name: &str) -> ParseResult<[f64; N]> {
        let element = self.object.get(tag).ok_or_else(|| missing(name))?;
        let numbers = element.to_multi_float64().ok();
        numbers
            .and_then(|n| <[f64; N]>::try_from(n).ok())
            .filter(|n| n.iter().all(|x| x.is_finite()))
            .ok_or_else(|| format!("`{name}` must be {N} finite numbers"))
    }

    /// Returns the slice with its pixels.
    pub fn slice(&self) -> ParseResult<Slice> {
        let frames: u32 = self.one(FRAMES, "NumberOfFrames")?.unwrap_or(1);
        if frames != 1 {
            return Err(format!(
                "`NumberOfFrames` must be 1 (one slice per file), got {frames}"
            ));
        }
        let samples: u16 = self.one(SAMPLES, "SamplesPerPixel")?.unwrap_or(1);
        let photometric = self.text(PHOTOMETRIC, "PhotometricInterpretation")?;
        if samples != 1 || !photometric.starts_with("MONOCHROME") {
            return Err(format!(
                "image has {samples} values per pixel ({photometric}); only grey images \
                (MONOCHROME2) are supported"
            ));
        }
        let [x, y, z, u, v, w] = self.reals(ORIENTATION, "ImageOrientationPatient")?;
        let axes = [DVec3::new(x, y, z), DVec3::new(u, v, w)];
        let square = axes[0].dot(axes[1]).abs() < 1e-3;
        if !square || axes.iter().any(|a| (a.length() - 1.0).abs() > 1e-3) {
            return Err(format!(
                "`ImageOrientationPatient` must be two unit vectors at right angles, got {axes:?}"
            ));
        }
        let [between_rows, between_columns] = self.reals(SPACING, "PixelSpacing")?;
        let spacing = DVec2::new(between_columns, between_rows);
        if spacing.cmple(DVec2::ZERO).any() {
            return Err(format!("`PixelSpacing` must be > 0, got {spacing}"));
        }
        let rows = usize::from(self.required::<u16>(ROWS, "Rows")?);
        let columns = usize::from(self.required::<u16>(COLUMNS, "Columns")?);
        if rows * columns == 0 {
            return Err(format!(
                "`Rows` and `Columns` must be ≥ 1, got {rows} and {columns}"
            ));
        }
        let slope = self.one(SLOPE, "RescaleSlope")?.unwrap_or(1.0);
        let intercept = self.one(INTERCEPT, "RescaleIntercept")?.unwrap_or(0.0);
        let scaling: [f64; 2] = [slope, intercept];
        if slope == 0.0 || scaling.iter().any(|s| !s.is_finite()) {
            return Err(format!(
                "`RescaleSlope` and `RescaleIntercept` must be finite, with a slope other than 0, \
                got {slope} and {intercept}"
            ));
        }
        Ok(Slice {
            columns,
            rows,
            position: DVec3::from(self.reals(POSITION, "ImagePositionPatient")?),
            axes,
            spacing,
            thickness: self.one(SLICE_THICKNESS, "SliceThickness")?,
            scaling,
            raw: self.pixels(rows * columns)?,
        })
    }

    fn pixels(&self, count: usize) -> ParseResult<Raw> {
        let bits: u16 = self.required(BITS, "BitsAllocated")?;
        let signed = self.one(SIGNED, "PixelRepresentation")?.unwrap_or(0u16) == 1;
        let scalar = match (bits, signed) {
            (8, false) => ScalarType::U8,
            (8, true) => ScalarType::I8,
            (16, false) => ScalarType::U16,
            (16, true) => ScalarType::I16,
            (32, false) => ScalarType::U32,
            (32, true) => ScalarType::I32,
            _ => {
                return Err(format!("`BitsAllocated` must be 8, 16 or 32, got {bits}"));
            }
        };
        let width = usize::from(bits / 8);
        let wanted = count * width;
        let element = self
            .object
            .get(PIXELS)
            .ok_or_else(|| missing("PixelData"))?;
        let raw = if NATIVE.contains(&self.syntax.as_str()) {
            let bytes = element
                .to_bytes()
                .map_err(|e| format!("`PixelData`: {e}"))?;
            let bytes = bytes.get(..wanted).ok_or_else(|| {
                format!(
                    "`PixelData` must have {wanted} bytes for its rows and columns, got {}",
                    bytes.len()
                )
            })?;
            // The crate has converted them to native byte order.
            decode(bytes, scalar, cfg!(target_endian = "big"))
        } else if self.syntax == RUN_LENGTH {
            // The first block is an offset table if there are several frames.
            let frame = element.fragments().and_then(|f| f.first());
            let frame = frame.ok_or("`PixelData` contains no image")?;
            decode(&run_lengths(frame, count, width)?, scalar, true)
        } else {
            return Err(format!(
                "compressed pixels (transfer syntax {}) are not supported; convert with `dcmdjpeg` \
                or `gdcmconv --raw`",
                self.syntax
            ));
        };
        let stored = self.one(BITS_STORED, "BitsStored")?.unwrap_or(bits);
        let high = self
            .one(HIGH_BIT, "HighBit")?
            .unwrap_or(stored.wrapping_sub(1));
        if stored == 0 || stored > bits || high >= bits || high + 1 < stored {
            return Err(format!(
                "`BitsStored` {stored} and `HighBit` {high} are inconsistent with `BitsAllocated` \
                {bits}"
            ));
        }
        Ok(without_overlay(raw, bits - 1 - high, bits - stored))
    }
}

fn missing(name: &str) -> String {
    format!("missing `{name}`")
}

/// Keeps the bits of the value: shifts left by `up`, then right by `down` with sign extension.
fn without_overlay(raw: Raw, up: u16, down: u16) -> Raw {
    macro_rules! shift {
        ($raw:ident, $values:ident) => {
            Raw::$raw($values.into_iter().map(|n| n << up >> down).collect())
        };
    }
    match raw {
        same if down == 0 => same,
        Raw::U8(v) => shift!(U8, v),
        Raw::I8(v) => shift!(I8, v),
        Raw::U16(v) => shift!(U16, v),
        Raw::I16(v) => shift!(I16, v),
        Raw::U32(v) => shift!(U32, v),
        Raw::I32(v) => shift!(I32, v),
        other => other,
    }
}

/// Decodes a run-length frame (DICOM part 5, annex G), most significant byte first.
fn run_lengths(frame: &[u8], count: usize, width: usize) -> ParseResult<Vec<u8>> {
    let number = |n: usize| -> Option<usize> {
        let bytes: [u8; 4] = frame.get(4 * n..4 * n + 4)?.try_into().ok()?;
        usize::try_from(u32::from_le_bytes(bytes)).ok()
    };
    if number(0) != Some(width) {
        return Err(format!(
            "run-length frame must have {width} segments, one per byte of a pixel"
        ));
    }
    let mut planes = Vec::new();
    for segment in 0..width {
        let packed = number(1 + segment).and_then(|start| frame.get(start..));
        let packed = packed.ok_or("a segment of the run-length frame begins beyond its end")?;
        planes.push(unpack_bits(packed, count).ok_or_else(|| {
            format!("segment {segment} of the run-length frame ends before {count} pixels")
        })?);
    }
    Ok((0..count)
        .flat_map(|n| planes.iter().map(move |plane| plane[n]))
        .collect())
}

/// Decodes `count` bytes of PackBits; `None` if there are fewer.
fn unpack_bits(mut packed: &[u8], count: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    while bytes.len() < count {
        let (head, rest) = packed.split_first()?;
        packed = rest;
        let head = usize::from(*head);
        match head {
            0..=127 => {
                bytes.extend_from_slice(packed.get(..head + 1)?);
                packed = &packed[head + 1..];
            }
            128 => {}
            _ => {
                let (value, rest) = packed.split_first()?;
                packed = rest;
                bytes.resize(bytes.len() + 257 - head, *value);
            }
        }
    }
    bytes.truncate(count);
    Some(bytes)
}
