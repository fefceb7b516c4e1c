//! Reader for MetaImage: a header with detached (.mhd) or attached (.mha) data.
//!
//! The format is described at itk.org/Wiki/MetaIO/Documentation; its world is LPS, in mm.

use super::pattern::data_files;
use super::voxels::{Packing, chosen, decode, decode_text, extent, one_of, unpack};
use super::{Fetch, joined};
use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use crate::volume::Volume;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;

/// Maximum number of data files of a LIST or a pattern.
const MAX_FILES: i64 = 100_000;

/// Whether a file begins with one of the fields that can start a header.
pub(super) fn is_metaimage(bytes: &[u8]) -> bool {
    let line = bytes
        .split(|b| *b == b'\n')
        .find(|l| !l.trim_ascii().is_empty());
    let line = String::from_utf8_lossy(line.unwrap_or_default());
    let Some((key, value)) = line.split_once('=') else {
        return false;
    };
    match key.trim() {
        "ObjectType" => value.trim().eq_ignore_ascii_case("image"),
        "NDims" | "Comment" | "ObjectSubType" => true,
        _ => false,
    }
}

/// The fields of a header, with their lines.
struct Header {
    fields: HashMap<String, (usize, String)>,
    /// The lines after the last field.
    rest_of_names: Vec<String>,
}

/// Parses the bytes of `file` as a volume: number `number` of several.
pub(super) fn read(file: &[u8], fetch: Fetch, number: Option<usize>) -> ParseResult<Volume> {
    let (header, attached) = Header::parse(file)?;
    let dimensions = header.whole("NDims")?.unwrap_or(3);
    let (size, frames) = header.size(dimensions)?;
    let channels = header.whole("ElementNumberOfChannels")?.unwrap_or(1).max(1);
    let many = || "the file has more values than memory can hold".to_owned();
    let count = frames.checked_mul(channels).ok_or_else(many)?;
    let what = match (frames, channels) {
        (1, _) => "values per voxel, `ElementNumberOfChannels`",
        (_, 1) => "`DimSize`",
        _ => "`DimSize` and `ElementNumberOfChannels`, which runs faster",
    };
    let number = chosen(number, count, what)?;
    let scalar = header.scalar_type()?;
    let (voxels, volume) = extent(size, scalar)?;
    let bytes = volume.checked_mul(count).ok_or_else(many)?;
    let data = header.data(attached, fetch, bytes)?;
    let mut notes = Vec::new();
    let mut all = match header.flag("BinaryData")?.unwrap_or(true) {
        true => header.binary(&data, [bytes, volume], &mut notes)?,
        false => decode_text(&data, scalar, voxels * count)?.to_bytes(),
    };
    if count > 1 {
        let frame = one_of(&all, volume * channels, frames, number / channels);
        all = one_of(&frame, volume / voxels, channels, number % channels);
    }
    Ok(Volume {
        size,
        raw: decode(&all, scalar, header.big_endian()?),
        slope: header
            .real("ElementToIntensityFunctionSlope")?
            .unwrap_or(1.0),
        intercept: header
            .real("ElementToIntensityFunctionOffset")?
            .unwrap_or(0.0),
        to_world: header.to_world(dimensions)?,
        notes,
        ..Volume::default()
    })
}

impl Header {
    /// Parses the header; returns it and the data after its line `ElementDataFile`.
    fn parse(file: &[u8]) -> ParseResult<(Header, &[u8])> {
        let mut header = Header {
            fields: HashMap::new(),
            rest_of_names: Vec::new(),
        };
        let mut rest = file;
        let mut number = 0;
        while !rest.is_empty() {
            number += 1;
            let end = rest.iter().position(|b| *b == b'\n');
            let line = &rest[..end.unwrap_or(rest.len())];
            rest = &rest[end.map_or(rest.len(), |e| e + 1)..];
            if line.trim_ascii().is_empty() {
                continue;
            }
            let line = String::from_utf8_lossy(line);
            let Some((key, value)) = line.split_once('=') else {
                return Err(format!(
                    "line {number}: expected \"Field = value\", found {:?}",
                    line.chars().take(40).collect::<String>()
                ));
            };
            let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
            let last = key == "ElementDataFile";
            let list = last && value.to_uppercase().starts_with("LIST");
            header.fields.insert(key, (number, value));
            if list {
                let names = String::from_utf8_lossy(rest);
                let names = names.lines().map(str::trim).filter(|l| !l.is_empty());
                header.rest_of_names = names.map(str::to_owned).collect();
            }
            if last {
                return Ok((header, rest));
            }
        }
        Err("header has no field `ElementDataFile` as its last field".into())
    }

    /// Returns the size of each volume and their number.
    fn size(&self, dimensions: usize) -> ParseResult<([usize; 3], usize)> {
        let sizes = self.numbers("DimSize", None)?;
        let sizes = sizes.ok_or("header has no field `DimSize`")?;
        if sizes.len() != dimensions {
            return Err(format!(
                "`NDims` is {dimensions}, but `DimSize` has {} numbers",
                sizes.len()
            ));
        }
        let whole = |s: &f64| (*s >= 1.0 && s.fract() == 0.0 && *s < 1e15).then_some(*s as usize);
        let whole: Option<Vec<usize>> = sizes.iter().map(whole).collect();
        let sizes =
            whole.ok_or_else(|| format!("`DimSize` must be integers ≥ 1, got {sizes:?}"))?;
        let [i, j, k, ref more @ ..] = sizes[..] else {
            return Err(format!(
                "sizes {sizes:?} are no volume; expected three axes"
            ));
        };
        let count = more.iter().try_fold(1usize, |n, s| n.checked_mul(*s));
        let count = count.ok_or("`DimSize` is larger than any file")?;
        Ok(([i, j, k], count))
    }

    /// Whether the most significant byte of binary data comes first.
    fn big_endian(&self) -> ParseResult<bool> {
        // Text was encoded by this program.
        let binary = self.flag("BinaryData")?.unwrap_or(true);
        let msb = match self.flag("BinaryDataByteOrderMSB")? {
            Some(msb) => msb,
            None => self.flag("ElementByteOrderMSB")?.unwrap_or(false),
        };
        Ok(binary && msb)
    }

    /// Decompresses the data: `all` bytes, the last of them a volume of `volume` bytes.
    fn binary(
        &self,
        data: &[u8],
        [all, volume]: [usize; 2],
        notes: &mut Vec<String>,
    ) -> ParseResult<Vec<u8>> {
        let packed = self.whole("CompressedDataSize")?.unwrap_or(0);
        if packed > data.len() {
            return Err(format!(
                "`CompressedDataSize` is {packed}, but the file has {} bytes of data (wrong size \
                in the header or truncated file)",
                data.len()
            ));
        }
        let packing = match self.flag("CompressedData")?.unwrap_or(false) {
            true if Packing::of(data) == Packing::Gzip => Packing::Gzip,
            true => Packing::Zlib,
            false => Packing::Raw,
        };
        unpack(data, packing, [all, volume], notes)
    }

    fn get(&self, name: &str) -> Option<(usize, &str)> {
        let found = self.fields.get(name);
        found.map(|(line, value)| (*line, value.as_str()))
    }

    /// Returns the numbers of a field; `count` of them, if given.
    fn numbers(&self, name: &str, count: Option<usize>) -> ParseResult<Option<Vec<f64>>> {
        let Some((line, text)) = self.get(name) else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = text
            .split_whitespace()
            .map(|w| w.parse().ok().filter(|v: &f64| v.is_finite()))
            .collect();
        match (numbers, count) {
            (Some(numbers), None) => Ok(Some(numbers)),
            (Some(numbers), Some(count)) if numbers.len() == count => Ok(Some(numbers)),
            (_, count) => Err(format!(
                "line {line}: `{name}` must be {} finite numbers, got \"{text}\"",
                count.map_or("some".to_owned(), |n| n.to_string())
            )),
        }
    }

    fn real(&self, name: &str) -> ParseResult<Option<f64>> {
        Ok(self.numbers(name, Some(1))?.map(|n| n[0]))
    }

    fn whole(&self, name: &str) -> ParseResult<Option<usize>> {
        let Some((line, text)) = self.get(name) else {
            return Ok(None);
        };
        match text.parse() {
            Ok(n) => Ok(Some(n)),
            Err(_) => Err(format!(
                "line {line}: `{name}` must be an integer ≥ 0, got \"{text}\""
            )),
        }
    }

    fn flag(&self, name: &str) -> ParseResult<Option<bool>> {
        match self.get(name) {
            None => Ok(None),
            Some((line, text)) => match text.to_lowercase().as_str() {
                "true" | "1" | "t" | "yes" => Ok(Some(true)),
                "false" | "0" | "f" | "no" => Ok(Some(false)),
                _ => Err(format!(
                    "line {line}: `{name}` must be True or False, got \"{text}\""
                )),
            },
        }
    }

    fn scalar_type(&self) -> ParseResult<ScalarType> {
        let (line, name) = self
            .get("ElementType")
            .ok_or("header has no field `ElementType`")?;
        Ok(match name.strip_suffix("_ARRAY").unwrap_or(name) {
            "MET_CHAR" => ScalarType::I8,
            "MET_UCHAR" => ScalarType::U8,
            "MET_SHORT" => ScalarType::I16,
            "MET_USHORT" => ScalarType::U16,
            // A long of this format has 32 bits on all machines.
            "MET_INT" | "MET_LONG" => ScalarType::I32,
            "MET_UINT" | "MET_ULONG" => ScalarType::U32,
            "MET_LONG_LONG" => ScalarType::I64,
            "MET_ULONG_LONG" => ScalarType::U64,
            "MET_FLOAT" => ScalarType::F32,
            "MET_DOUBLE" => ScalarType::F64,
            _ => {
                return Err(format!(
                    "line {line}: element type \"{name}\" is not supported; expected a scalar type \
                    (for example MET_SHORT)"
                ));
            }
        })
    }

    /// Reads the data, from this file or from the named ones, without their headers.
    fn data(&self, attached: &[u8], fetch: Fetch, bytes: usize) -> ParseResult<Vec<u8>> {
        let (line, named) = self.get("ElementDataFile").unwrap_or((0, ""));
        let names = if named.eq_ignore_ascii_case("LOCAL") {
            return Ok(self.after_header(attached, bytes)?.to_vec());
        } else if named.to_uppercase().starts_with("LIST") {
            self.rest_of_names.clone()
        } else {
            data_files(named, fetch).ok_or_else(|| {
                format!(
                    "line {line}: `ElementDataFile` must be LOCAL, LIST, the name of a file, or \
                    \"NAME%03d FIRST LAST STEP\", got \"{named}\""
                )
            })?
        };
        let unnamed = names.iter().any(|n| n.is_empty());
        if names.is_empty() || unnamed || names.len() as i64 > MAX_FILES {
            return Err(format!(
                "line {line}: `ElementDataFile` is \"{named}\", which names {} files of data",
                names.len()
            ));
        }
        let each = bytes / names.len();
        joined(&names, bytes, &|name| {
            let file = fetch(name)?;
            Ok(self.after_header(&file, each)?.to_vec())
        })
    }

    fn after_header<'a>(&self, file: &'a [u8], bytes: usize) -> ParseResult<&'a [u8]> {
        match self.get("HeaderSize") {
            None => Ok(file),
            // The data are at the end of the file.
            Some((_, "-1")) => Ok(&file[file.len().saturating_sub(bytes)..]),
            Some(_) => {
                let skip = self.whole("HeaderSize")?.unwrap_or(0);
                file.get(skip..).ok_or_else(|| {
                    format!(
                        "`HeaderSize` is {skip}, but the data file has only {} bytes",
                        file.len()
                    )
                })
            }
        }
    }

    fn to_world(&self, dimensions: usize) -> ParseResult<DAffine3> {
        let first = |names: &[&str], count: usize| -> ParseResult<Option<Vec<f64>>> {
            for name in names {
                if let Some(numbers) = self.numbers(name, Some(count))? {
                    return Ok(Some(numbers));
                }
            }
            Ok(None)
        };
        let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
        let spacing = first(&["ElementSpacing", "ElementSize"], dimensions)?;
        let spacing = spacing.map_or(DVec3::ONE, |s| vector(&s));
        let origin = first(&["Offset", "Origin", "Position"], dimensions)?;
        let origin = origin.map_or(DVec3::ZERO, |o| vector(&o));
        // One row for each axis of the image: its direction.
        let matrix = ["TransformMatrix", "Rotation", "Orientation"];
        let axes = match first(&matrix, dimensions * dimensions)? {
            Some(m) => {
                let row = |n: usize| vector(&m[n * dimensions..]);
                DMat3::from_cols(row(0), row(1), row(2))
            }
            None => DMat3::IDENTITY,
        };
        let lps_to_ras = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        let linear = lps_to_ras * axes * DMat3::from_diagonal(spacing);
        if linear.determinant() == 0.0 || !linear.is_finite() {
            return Err(
                "voxels have zero volume; check `ElementSpacing` and `TransformMatrix`".into(),
            );
        }
        Ok(DAffine3::from_mat3_translation(linear, lps_to_ras * origin))
    }
}
