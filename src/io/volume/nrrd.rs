//! Reader for NRRD with attached (.nrrd) or detached data (.nhdr).
//!
//! The format is described at teem.sourceforge.net/nrrd/format.html.

use super::nrrd_space::Axes;
use super::pattern::data_files;
use super::voxels::{Packing, bytes_in, chosen, decode, decode_text, extent, one_of, unpack};
use super::{Fetch, joined, segmentation};
use crate::io::cursor::ParseResult;
use crate::mesh::ScalarType;
use crate::volume::{Raw, Volume};
use std::collections::HashMap;

/// Magic bytes of the format.
pub(super) const MAGIC: &[u8] = b"NRRD000";

/// Maximum number of bytes before voxels that are the last bytes of compressed data.
const MAX_SKIPPED_BYTES: usize = 1 << 26;

/// The fields and key/value pairs of a header.
pub(super) struct Header {
    /// By name in lower case, with their line.
    fields: HashMap<String, (usize, String)>,
    pairs: Vec<(String, String)>,
}

/// Parses the bytes of `file` as a volume: number `number` of several. The layers of a segmentation of
/// 3D Slicer are merged, unless one is requested.
pub(super) fn read(file: &[u8], fetch: Fetch, number: Option<usize>) -> ParseResult<Volume> {
    if !file.starts_with(MAGIC) {
        return Err("line 1: expected NRRD0001 to NRRD0005".into());
    }
    let (header, data) = Header::parse(file)?;
    let scalar = scalar_type(&header)?;
    let axes = Axes::new(&header)?;
    let segments = segmentation::segments(&header.pairs, axes.count);
    let merged = number.is_none() && axes.count > 1 && !segments.is_empty();
    let number = match merged {
        true => 0,
        false => chosen(number, axes.count, "several values per voxel, in `sizes`")?,
    };
    let (voxels, volume) = extent(axes.size, scalar)?;
    let bytes = volume
        .checked_mul(axes.count)
        .ok_or("`sizes` are larger than any file")?;
    let packed = header.data(data, bytes, fetch)?;
    let mut notes = Vec::new();
    let sizes = [voxels.saturating_mul(axes.count), bytes, volume];
    let (all, big_endian) = header.voxels(&packed, scalar, sizes, &mut notes)?;
    let block = axes.faster.saturating_mul(bytes_in(scalar));
    let one = |k: usize| match axes.count {
        1 => decode(&all, scalar, big_endian),
        count => decode(&one_of(&all, block, count, k), scalar, big_endian),
    };
    let volume = Volume {
        size: axes.size,
        raw: Raw::U8(Vec::new()),
        to_world: axes.to_world,
        notes,
        ..Volume::default()
    };
    Ok(match merged {
        true => segmentation::merged(volume, &segments, axes.count, one),
        false => segmentation::named(
            Volume {
                raw: one(number),
                ..volume
            },
            &segments,
            number,
        ),
    })
}

impl Header {
    /// Parses the header; returns it and the bytes after its empty line.
    fn parse(file: &[u8]) -> ParseResult<(Header, &[u8])> {
        let mut header = Header {
            fields: HashMap::new(),
            pairs: Vec::new(),
        };
        let mut rest = file;
        let mut number = 0;
        while !rest.is_empty() {
            number += 1;
            let end = rest.iter().position(|b| *b == b'\n');
            let line = &rest[..end.unwrap_or(rest.len())];
            rest = &rest[end.map_or(rest.len(), |e| e + 1)..];
            let line = String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line));
            if line.is_empty() {
                return Ok((header, rest));
            }
            if number == 1 || line.starts_with('#') {
                continue;
            }
            if let Some((key, value)) = line.split_once(":=") {
                header
                    .pairs
                    .push((key.trim().to_owned(), value.trim().to_owned()));
            } else if let Some((name, value)) = line.split_once(':') {
                let name = name.trim().to_lowercase();
                let value = value.trim().to_owned();
                let list = matches!(name.as_str(), "data file" | "datafile")
                    && value.to_uppercase().starts_with("LIST");
                header.fields.insert(name, (number, value));
                if list {
                    // The names follow, up to the end of the file.
                    let names = String::from_utf8_lossy(rest);
                    let names = names.lines().map(str::trim).filter(|l| !l.is_empty());
                    header
                        .pairs
                        .extend(names.map(|n| (String::new(), n.to_owned())));
                    return Ok((header, &[]));
                }
            } else {
                return Err(format!(
                    "line {number}: expected \"field: value\", found {:?}",
                    line.chars().take(40).collect::<String>()
                ));
            }
        }
        Ok((header, &[]))
    }

    pub fn get(&self, name: &str) -> Option<(usize, &str)> {
        let joined = name.replace(' ', "");
        let found = self.fields.get(name).or_else(|| self.fields.get(&joined));
        found.map(|(line, value)| (*line, value.as_str()))
    }

    pub fn require(&self, name: &str) -> ParseResult<(usize, &str)> {
        self.get(name)
            .ok_or_else(|| format!("header has no field `{name}`"))
    }

    pub fn number(&self, name: &str) -> ParseResult<Option<usize>> {
        let Some((line, value)) = self.get(name) else {
            return Ok(None);
        };
        match value.parse() {
            Ok(n) => Ok(Some(n)),
            Err(_) => Err(format!(
                "line {line}: `{name}` must be an integer ≥ 0, got \"{value}\""
            )),
        }
    }

    /// Returns `byte skip`; `None` if it is -1, i.e. the data are at the end of the file.
    fn byte_skip(&self) -> ParseResult<Option<usize>> {
        match self.get("byte skip") {
            None => Ok(Some(0)),
            Some((_, "-1")) => Ok(None),
            Some(_) => self.number("byte skip"),
        }
    }

    /// Decompresses the voxels in `packed`: their `values` in as many `bytes`, the last `volume` of
    /// them the last volume. Returns them with whether they are big-endian.
    fn voxels(
        &self,
        packed: &[u8],
        scalar: ScalarType,
        [values, bytes, volume]: [usize; 3],
        notes: &mut Vec<String>,
    ) -> ParseResult<(Vec<u8>, bool)> {
        let encoding = self.require("encoding")?.1.to_lowercase();
        let all = match encoding.as_str() {
            "txt" | "text" | "ascii" => {
                let text = self.skipped(packed, None)?;
                let values = decode_text(text, scalar, values)?;
                // Encoded little-endian.
                return Ok((values.to_bytes(), false));
            }
            "raw" => {
                let block = self.skipped(packed, Some(bytes))?;
                let known = Packing::of(block);
                match block.len() < bytes && known != Packing::Raw {
                    true => {
                        let all = self.unpacked(packed, known, [bytes, volume], notes)?;
                        notes.push(
                            "`encoding` is raw, but the data are compressed and were decompressed"
                                .into(),
                        );
                        all
                    }
                    false => unpack(block, Packing::Raw, [bytes, volume], notes)?,
                }
            }
            "gz" | "gzip" => self.unpacked(packed, Packing::Gzip, [bytes, volume], notes)?,
            "bz2" | "bzip2" => self.unpacked(packed, Packing::Bzip2, [bytes, volume], notes)?,
            other => {
                return Err(format!(
                    "encoding \"{other}\" is not supported; use raw, gzip, bzip2 or text (convert \
                    with `unu save -e gzip`)"
                ));
            }
        };
        Ok((all, self.big_endian(scalar)?))
    }

    /// Decompresses `packed` after its skipped lines. Bytes are skipped in the decompressed data;
    /// with `byte skip: -1` the voxels are their last bytes, such as those after another header.
    fn unpacked(
        &self,
        packed: &[u8],
        packing: Packing,
        [bytes, volume]: [usize; 2],
        notes: &mut Vec<String>,
    ) -> ParseResult<Vec<u8>> {
        let block = after_lines(packed, self.number("line skip")?.unwrap_or(0))?;
        match self.byte_skip()? {
            Some(skip) => {
                let wanted = bytes
                    .checked_add(skip)
                    .ok_or("`byte skip` is larger than any file")?;
                let mut all = unpack(block, packing, [wanted, volume], notes)?;
                Ok(all.split_off(skip))
            }
            None => {
                let limit = bytes.saturating_add(MAX_SKIPPED_BYTES) as u64;
                let mut all = packing
                    .take(block, limit)
                    .map_err(|e| format!("cannot decompress the voxels: {e}"))?;
                let skip = all.len().saturating_sub(bytes);
                unpack(&all.split_off(skip), Packing::Raw, [bytes, volume], notes)
            }
        }
    }

    /// Reads the data, from this file or from the named ones.
    fn data(&self, attached: &[u8], bytes: usize, fetch: Fetch) -> ParseResult<Vec<u8>> {
        let Some((line, named)) = self.get("data file") else {
            if attached.is_empty() {
                return Err("unexpected end of file after the header, expected the voxels".into());
            }
            return Ok(attached.to_vec());
        };
        let listed: Vec<String> = self
            .pairs
            .iter()
            .filter(|(key, _)| key.is_empty())
            .map(|(_, name)| name.clone())
            .collect();
        let names = match named.to_uppercase().starts_with("LIST") {
            true => listed,
            false => data_files(named, fetch).ok_or_else(|| {
                format!(
                    "line {line}: `data file` must be the name of a file, LIST, or \"NAME%03d \
                    FIRST LAST STEP\", got \"{named}\""
                )
            })?,
        };
        if names.is_empty() || names.iter().any(|n| n.is_empty()) {
            return Err(format!(
                "line {line}: `data file` \"{named}\" names no file"
            ));
        }
        if names.len() > 1 && self.byte_skip()? != Some(0) {
            return Err(
                "`byte skip` with several data files is not supported; concatenate them \
                first"
                    .into(),
            );
        }
        joined(&names, bytes, fetch)
    }

    /// Returns `data` after the skipped lines and bytes; the last `wanted` bytes if the header
    /// requests it.
    fn skipped<'a>(&self, data: &'a [u8], wanted: Option<usize>) -> ParseResult<&'a [u8]> {
        let data = after_lines(data, self.number("line skip")?.unwrap_or(0))?;
        match (self.byte_skip()?, wanted) {
            (Some(skip), _) => data.get(skip..).ok_or_else(|| {
                format!(
                    "`byte skip` is {skip}, but there are only {} bytes of data",
                    data.len()
                )
            }),
            (None, Some(wanted)) => Ok(&data[data.len().saturating_sub(wanted)..]),
            (None, None) => Err("`byte skip: -1` is valid for raw data only".into()),
        }
    }

    fn big_endian(&self, scalar: ScalarType) -> ParseResult<bool> {
        match self.get("endian") {
            Some((_, value)) if value.eq_ignore_ascii_case("little") => Ok(false),
            Some((_, value)) if value.eq_ignore_ascii_case("big") => Ok(true),
            None if bytes_in(scalar) == 1 => Ok(false),
            None => Err(format!(
                "missing field `endian` (little or big), required for numbers of {} bytes",
                bytes_in(scalar)
            )),
            Some((line, value)) => Err(format!(
                "line {line}: `endian` must be little or big, got \"{value}\""
            )),
        }
    }
}

fn after_lines(mut data: &[u8], lines: usize) -> ParseResult<&[u8]> {
    for skipped in 0..lines {
        let end = data.iter().position(|b| *b == b'\n').ok_or_else(|| {
            format!("`line skip` is {lines}, but the data has only {skipped} lines")
        })?;
        data = &data[end + 1..];
    }
    Ok(data)
}

fn scalar_type(header: &Header) -> ParseResult<ScalarType> {
    let (line, name) = header.require("type")?;
    Ok(match name.to_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => ScalarType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            ScalarType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            ScalarType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => ScalarType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => ScalarType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            ScalarType::U64
        }
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        _ => {
            return Err(format!(
                "line {line}: type \"{name}\" is not supported; use integers of 8 to 64 bits, \
                float or double"
            ));
        }
    })
}
