//! A slice of a volume in a DICOM file.

use super::element_scan::{self, GroupElement};
use crate::io::cursor::ParseResult;
use crate::io::volume::voxels::decode;
use crate::mesh::ScalarType;
use crate::volume::Raw;
use dicom_core::header::HasLength;
use dicom_core::value::InMemFragment;
use dicom_object::{DefaultDicomObject, OpenFileOptions, Tag};
use glam::{DVec2, DVec3};
use std::borrow::Cow;
use std::collections::HashMap;
use std::str::FromStr;

const SPACING_BETWEEN: Tag = Tag(0x0018, 0x0088);
const OFFSETS: Tag = Tag(0x3004, 0x000c);
const DOSE_SCALING: Tag = Tag(0x3004, 0x000e);
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

const WANTED: [Tag; 20] = [
    SPACING_BETWEEN,
    OFFSETS,
    DOSE_SCALING,
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

/// What the functional groups of a multi-frame image state per frame.
const IN_GROUPS: [Tag; 6] = [
    SLICE_THICKNESS,
    POSITION,
    ORIENTATION,
    SPACING,
    INTERCEPT,
    SLOPE,
];

/// The transfer syntaxes with uncompressed pixels.
const NATIVE: [&str; 3] = [
    "1.2.840.10008.1.2",
    "1.2.840.10008.1.2.1",
    "1.2.840.10008.1.2.2",
];
/// Maximum number of frames of an image.
const MAX_FRAMES: usize = 1 << 20;
const RUN_LENGTH: &str = "1.2.840.10008.1.2.5";

/// A parsed file with an image in it.
pub(super) struct Image {
    object: DefaultDicomObject,
    syntax: String,
    /// Elements of the functional groups of one frame, or of all of them.
    groups: HashMap<(Option<usize>, Tag), String>,
    /// Its series.
    pub series: String,
}

/// The encoded pixels of all frames of an image.
pub(super) enum PixelData<'a> {
    Native(Cow<'a, [u8]>),
    /// Run lengths, a block per frame.
    RunLengths(&'a [InMemFragment]),
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
        let found = element_scan::extract_elements(file, &WANTED, &IN_GROUPS)?;
        let mut groups = HashMap::new();
        for GroupElement { frame, tag, text } in found.groups {
            groups.entry((frame, tag)).or_insert(text);
        }
        let object = OpenFileOptions::new()
            .from_reader(found.sifted.as_slice())
            .map_err(|e| format!("invalid DICOM: {e}"))?;
        if object.get(PIXELS).is_none() {
            return Ok(None);
        }
        let mut image = Image {
            object,
            syntax: found.syntax,
            groups,
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

    /// Returns the numbers of an element: that of frame `frame` if its functional group has one, or
    /// else the one for all frames. The number of them is `N`, if it is present.
    fn reals<const N: usize>(
        &self,
        tag: Tag,
        name: &str,
        frame: usize,
    ) -> ParseResult<Option<[f64; N]>> {
        let numbers: Option<Vec<f64>> = match self.in_group(tag, frame) {
            Some("") => return Ok(None),
            Some(text) => text.split('\\').map(|w| w.trim().parse().ok()).collect(),
            None => match self.object.get(tag) {
                Some(element) if !element.is_empty() => element.to_multi_float64().ok(),
                _ => return Ok(None),
            },
        };
        let numbers = numbers.and_then(|n| <[f64; N]>::try_from(n).ok());
        match numbers.filter(|n| n.iter().all(|x| x.is_finite())) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(format!("`{name}` must be {N} finite numbers")),
        }
    }

    fn in_group(&self, tag: Tag, frame: usize) -> Option<&str> {
        let own = self.groups.get(&(Some(frame), tag));
        let found = own.or_else(|| self.groups.get(&(None, tag)));
        found.map(String::as_str)
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> ParseResult<usize> {
        let frames = self.one::<usize>(FRAMES, "NumberOfFrames")?.unwrap_or(1);
        match (1..=MAX_FRAMES).contains(&frames) {
            true => Ok(frames),
            false => Err(format!(
                "`NumberOfFrames` must be in [1, {MAX_FRAMES}], got {frames}"
            )),
        }
    }

    /// Returns the distances of frames from the position of the image along the normal, if it states
    /// them: those of a dose, or multiples of a step for `frames` frames.
    pub fn offsets(&self, frames: usize) -> ParseResult<Option<Vec<f64>>> {
        if let Some(element) = self.object.get(OFFSETS) {
            let offsets = element.to_multi_float64().unwrap_or_default();
            if offsets.len() != frames || offsets.iter().any(|o| !o.is_finite()) {
                return Err(format!(
                    "`GridFrameOffsetVector` must be a number per frame ({frames}), got {}",
                    offsets.len()
                ));
            }
            return Ok(Some(offsets));
        }
        let between = self.one::<f64>(SPACING_BETWEEN, "SpacingBetweenSlices")?;
        let step = match between {
            Some(step) => Some(step),
            None => self.one(SLICE_THICKNESS, "SliceThickness")?,
        };
        let step = step.filter(|s| *s != 0.0 && s.is_finite());
        Ok(step.map(|step| (0..frames).map(|n| step * n as f64).collect()))
    }

    /// Whether each frame has a position of its own.
    pub fn places_frames(&self) -> bool {
        self.groups.contains_key(&(Some(0), POSITION))
    }

    /// Returns the encoded pixels of all frames.
    pub fn pixel_data(&self) -> ParseResult<PixelData<'_>> {
        let element = self.object.get(PIXELS);
        let element = element.ok_or_else(|| missing("PixelData"))?;
        if NATIVE.contains(&self.syntax.as_str()) {
            let bytes = element.to_bytes();
            let bytes = bytes.map_err(|e| format!("`PixelData`: {e}"))?;
            Ok(PixelData::Native(bytes))
        } else if self.syntax == RUN_LENGTH {
            let frames = element.fragments();
            Ok(PixelData::RunLengths(frames.unwrap_or_default()))
        } else {
            Err(format!(
                "compressed pixels (transfer syntax {}) are not supported; convert with `dcmdjpeg` \
                or `gdcmconv --raw`",
                self.syntax
            ))
        }
    }

    /// Returns the slice of frame `frame` with its `pixels`.
    pub fn slice(&self, pixels: &PixelData, frame: usize) -> ParseResult<Slice> {
        let samples: u16 = self.one(SAMPLES, "SamplesPerPixel")?.unwrap_or(1);
        let photometric = self.text(PHOTOMETRIC, "PhotometricInterpretation")?;
        if samples != 1 || !photometric.starts_with("MONOCHROME") {
            return Err(format!(
                "image has {samples} values per pixel ({photometric}); only grey images \
                (MONOCHROME2) are supported"
            ));
        }
        let orientation = self.reals(ORIENTATION, "ImageOrientationPatient", frame)?;
        let [x, y, z, u, v, w] = orientation.ok_or_else(|| missing("ImageOrientationPatient"))?;
        let axes = [DVec3::new(x, y, z), DVec3::new(u, v, w)];
        let square = axes[0].dot(axes[1]).abs() < 1e-3;
        if !square || axes.iter().any(|a| (a.length() - 1.0).abs() > 1e-3) {
            return Err(format!(
                "`ImageOrientationPatient` must be two unit vectors at right angles, got {axes:?}"
            ));
        }
        let spacing = self.reals(SPACING, "PixelSpacing", frame)?;
        let [between_rows, between_columns] = spacing.ok_or_else(|| missing("PixelSpacing"))?;
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
        let position = self.reals(POSITION, "ImagePositionPatient", frame)?;
        let position = position.ok_or_else(|| missing("ImagePositionPatient"))?;
        let thickness = self.reals::<1>(SLICE_THICKNESS, "SliceThickness", frame);
        Ok(Slice {
            columns,
            rows,
            position: DVec3::from(position),
            axes,
            spacing,
            thickness: thickness?.map(|[t]| t),
            scaling: self.scaling(frame)?,
            raw: self.pixels(pixels, rows * columns, frame)?,
        })
    }

    /// Returns factor and offset from stored numbers to values.
    fn scaling(&self, frame: usize) -> ParseResult<[f64; 2]> {
        let dose = self.one(DOSE_SCALING, "DoseGridScaling")?;
        let slope = self.reals::<1>(SLOPE, "RescaleSlope", frame)?;
        let slope = slope.map(|[s]| s).or(dose).unwrap_or(1.0);
        let intercept = self.reals::<1>(INTERCEPT, "RescaleIntercept", frame)?;
        let intercept = intercept.map_or(0.0, |[i]| i);
        match slope != 0.0 && slope.is_finite() && intercept.is_finite() {
            true => Ok([slope, intercept]),
            false => Err(format!(
                "`RescaleSlope` and `RescaleIntercept` must be finite, with a slope other than 0, \
                got {slope} and {intercept}"
            )),
        }
    }

    fn pixels(&self, data: &PixelData, count: usize, frame: usize) -> ParseResult<Raw> {
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
        let raw = match data {
            PixelData::Native(bytes) => {
                let range = wanted * frame..wanted * (frame + 1);
                let bytes = bytes.get(range).ok_or_else(|| {
                    format!(
                        "`PixelData` must have {wanted} bytes per frame for its rows and columns, \
                        got {} in all",
                        bytes.len()
                    )
                })?;
                // The crate has converted them to native byte order.
                decode(bytes, scalar, cfg!(target_endian = "big"))
            }
            PixelData::RunLengths(frames) => {
                let packed = frames
                    .get(frame)
                    .ok_or("`PixelData` has fewer images than frames")?;
                decode(&run_lengths(packed, count, width)?, scalar, true)
            }
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
