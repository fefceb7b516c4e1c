//! Data arrays of VTK XML files: ASCII, base64 or raw, uncompressed or in compressed blocks.

use super::cursor::{Cursor, ParseResult};
use super::scalar;
use crate::mesh::ScalarType;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::borrow::Cow;
use std::io::Read;

/// The data encoding of a file: the attributes of `<VTKFile>`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub big_endian: bool,
    /// Whether headers are UInt64 (otherwise UInt32).
    pub wide_headers: bool,
    /// Compression of the blocks that arrays consist of.
    pub compressor: Option<Compressor>,
}

/// Compression of a block of data.
#[derive(Clone, Copy, Debug)]
pub(super) enum Compressor {
    Zlib,
    Lz4,
    Lzma,
}

/// Location and encoding of the bytes of an array.
pub(super) enum Source<'a> {
    /// Numbers as text: the file up to the array's end, and the start of the array.
    Ascii { file: &'a [u8], start: usize },
    /// Raw bytes, from the array's start to the end of the section.
    Raw(&'a [u8]),
    /// Base64 from the array's start to the end of the section.
    Base64(&'a [u8]),
}

/// Reads the numbers of one array, of which there must be `count` if it is known.
pub(super) fn numbers(
    source: Source,
    layout: Layout,
    scalar: ScalarType,
    count: Option<usize>,
) -> ParseResult<Vec<f64>> {
    let mut bytes = match source {
        Source::Ascii { file, start } => return ascii(file, start, scalar, count),
        Source::Raw(data) => Bytes::new(data, false),
        Source::Base64(data) => Bytes::new(data, true),
    };
    let sized = |n: usize| n.checked_mul(scalar::size(scalar));
    let expected = match count {
        Some(n) => Some(sized(n).ok_or("its size exceeds the addressable range")?),
        None => None,
    };
    let data = if let Some(compressor) = layout.compressor {
        decompress_blocks(&mut bytes, layout, compressor, expected)?
    } else {
        let [length] = bytes.header(layout)?;
        if let Some(expected) = expected
            && length != expected as u64
        {
            return Err(format!("header states {length} bytes, expected {expected}"));
        }
        bytes.take(usize::try_from(length).map_err(|e| e.to_string())?)?
    };
    Ok(scalar::decode(&data, scalar, layout.big_endian))
}

fn ascii(
    file: &[u8],
    start: usize,
    scalar: ScalarType,
    count: Option<usize>,
) -> ParseResult<Vec<f64>> {
    let mut at = Cursor::new(file);
    at.go_to(start);
    if let Some(count) = count {
        at.validate_count(count as i64, format_args!("the number of values"), 2)?;
    }
    let mut values = Vec::with_capacity(count.unwrap_or(0));
    loop {
        let i = values.len();
        let value = match count {
            Some(count) if i < count => at.number(format_args!("value {i} of {count}"))?,
            None if at.peek().is_some() => at.number(format_args!("value {i}"))?,
            _ => break,
        };
        values.push(if scalar == ScalarType::F32 {
            f64::from(value as f32)
        } else {
            value
        });
    }
    match at.token() {
        None => Ok(values),
        Some(_) => Err(at.error(format_args!(
            "more than the expected {} values",
            values.len()
        ))),
    }
}

/// Decompresses the blocks. Header: number of blocks, their size, the size of the last one (0: a
/// full one), the compressed size of each.
fn decompress_blocks<'a>(
    bytes: &mut Bytes<'a>,
    layout: Layout,
    compressor: Compressor,
    expected: Option<usize>,
) -> ParseResult<Cow<'a, [u8]>> {
    let [blocks] = bytes.header(layout)?;
    if blocks == 0 && expected.unwrap_or(0) == 0 {
        return Ok(Cow::Borrowed(&[]));
    }
    let [size, last] = bytes.header(layout)?;
    let total = blocks
        .checked_sub(u64::from(last != 0))
        .and_then(|whole| whole.checked_mul(size)?.checked_add(last));
    let fits = expected.is_none_or(|bytes| total == Some(bytes as u64));
    if total.is_none() || !fits || last > size {
        let expected = expected.map_or(String::new(), |n| format!(", expected {n} bytes in total"));
        return Err(format!(
            "header states {blocks} blocks of {size} bytes (the last {last}){expected}"
        ));
    }
    let blocks = usize::try_from(blocks).map_err(|e| e.to_string())?;
    let width = if layout.wide_headers { 8 } else { 4 };
    let header = bytes.take(blocks.checked_mul(width).ok_or("too many blocks")?)?;
    let mut out = Vec::new();
    for (block, head) in header.chunks_exact(width).enumerate() {
        let packed = bytes.take(whole_number(head, layout)?)?;
        let wanted = if block + 1 == blocks && last != 0 {
            last
        } else {
            size
        };
        let length = compressor
            .decompress(&packed, wanted, &mut out)
            .map_err(|e| {
                format!("cannot decompress block {block} of {blocks} with {compressor:?}: {e}")
            })?;
        if length != wanted {
            return Err(format!(
                "block {block} of {blocks} decompresses to {length} bytes, expected {wanted}"
            ));
        }
    }
    Ok(Cow::Owned(out))
}

impl Compressor {
    /// Appends the decompressed block `packed` to `out`, up to one byte more than `wanted`. Returns
    /// its length.
    fn decompress(self, packed: &[u8], wanted: u64, out: &mut Vec<u8>) -> ParseResult<u64> {
        let before = out.len();
        match self {
            // One extra byte, to detect a block that is too long.
            Compressor::Zlib => flate2::read::ZlibDecoder::new(packed)
                .take(wanted + 1)
                .read_to_end(out)
                .map(|_| ())
                .map_err(|e| e.to_string())?,
            Compressor::Lz4 => {
                // A byte of a compressed block stands for 255 bytes at most.
                let most = (packed.len() as u64 + 1) * 255;
                if wanted > most {
                    return Err(format!(
                        "its {} bytes cannot contain {wanted}",
                        packed.len()
                    ));
                }
                out.resize(before + wanted as usize, 0);
                let length = lz4_flex::block::decompress_into(packed, &mut out[before..])
                    .map_err(|e| e.to_string())?;
                out.truncate(before + length);
            }
            Compressor::Lzma => {
                let mut packed = packed;
                lzma_rs::xz_decompress(&mut packed, out).map_err(|e| match e {
                    lzma_rs::error::Error::IoError(e) => e.to_string(),
                    other => format!("{other:?}"),
                })?;
            }
        }
        Ok((out.len() - before) as u64)
    }
}

fn whole_number(bytes: &[u8], layout: Layout) -> ParseResult<usize> {
    let value = match *bytes {
        [a, b, c, d] if layout.big_endian => u64::from(u32::from_be_bytes([a, b, c, d])),
        [a, b, c, d] => u64::from(u32::from_le_bytes([a, b, c, d])),
        [a, b, c, d, e, f, g, h] if layout.big_endian => {
            u64::from_be_bytes([a, b, c, d, e, f, g, h])
        }
        [a, b, c, d, e, f, g, h] => u64::from_le_bytes([a, b, c, d, e, f, g, h]),
        _ => return Err("header is truncated".into()),
    };
    usize::try_from(value).map_err(|e| e.to_string())
}

/// Sequential reader of raw or base64 data.
struct Bytes<'a> {
    data: &'a [u8],
    base64: bool,
    /// Decoded but not yet consumed.
    pending: Vec<u8>,
}

impl<'a> Bytes<'a> {
    fn new(data: &'a [u8], base64: bool) -> Bytes<'a> {
        Bytes {
            data,
            base64,
            pending: Vec::new(),
        }
    }

    /// Returns the next `N` numbers of the header's width.
    fn header<const N: usize>(&mut self, layout: Layout) -> ParseResult<[u64; N]> {
        let width = if layout.wide_headers { 8 } else { 4 };
        let bytes = self.take(N * width)?;
        let mut numbers = [0; N];
        for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(width)) {
            *number = whole_number(bytes, layout)? as u64;
        }
        Ok(numbers)
    }

    fn take(&mut self, length: usize) -> ParseResult<Cow<'a, [u8]>> {
        let short = || format!("data are truncated: {length} more bytes expected");
        if !self.base64 {
            let (front, rest) = self.data.split_at_checked(length).ok_or_else(short)?;
            self.data = rest;
            return Ok(Cow::Borrowed(front));
        }
        if length > self.pending.len() + self.data.len() {
            return Err(short());
        }
        while self.pending.len() < length {
            if !self.decode_run(length - self.pending.len())? {
                return Err(short());
            }
        }
        let rest = self.pending.split_off(length);
        Ok(Cow::Owned(std::mem::replace(&mut self.pending, rest)))
    }

    /// Decodes the base64 of about `wanted` bytes, up to the first padding, since header and data
    /// may be encoded separately. Returns false at the end of the data.
    fn decode_run(&mut self, wanted: usize) -> ParseResult<bool> {
        let most = wanted.div_ceil(3) * 4;
        let mut run = Vec::with_capacity(most.min(self.data.len()));
        let mut used = 0;
        for byte in self.data {
            if run.len() >= most || (run.len() % 4 == 0 && run.last() == Some(&b'=')) {
                break;
            }
            used += 1;
            if !byte.is_ascii_whitespace() {
                run.push(*byte);
            }
        }
        if run.is_empty() {
            return Ok(false);
        }
        self.data = &self.data[used..];
        STANDARD
            .decode_vec(&run, &mut self.pending)
            .map_err(|e| format!("invalid base64: {e}"))?;
        Ok(true)
    }
}
