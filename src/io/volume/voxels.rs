//! Decoding of voxels from the bytes of a file.

use crate::io::cursor::{Cursor, ParseResult, number};
use crate::mesh::ScalarType;
use crate::volume::Raw;
use bzip2::read::MultiBzDecoder;
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use std::io::Read;

/// Returns the size of a number in bytes.
pub(super) fn bytes_in(scalar: ScalarType) -> usize {
    match scalar {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::I64 | ScalarType::U64 | ScalarType::F64 => 8,
    }
}

/// Returns the number of voxels and their size in bytes, if neither overflows.
pub(super) fn extent(size: [usize; 3], scalar: ScalarType) -> ParseResult<(usize, usize)> {
    let voxels = size.iter().try_fold(1usize, |n, s| n.checked_mul(*s));
    voxels
        .and_then(|n| Some((n, n.checked_mul(bytes_in(scalar))?)))
        .filter(|(n, _)| *n > 0)
        .ok_or_else(|| {
            let [i, j, k] = size;
            format!("volume size must be ≥ 1 along each axis and addressable, got {i} × {j} × {k}")
        })
}

/// Compression of data bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Raw,
    Gzip,
    Zlib,
    Bzip2,
}

impl Packing {
    /// Returns the compression that the first bytes of a file show.
    pub fn of(file: &[u8]) -> Packing {
        match file {
            [0x1f, 0x8b, ..] => Packing::Gzip,
            [b'B', b'Z', b'h', b'1'..=b'9', ..] => Packing::Bzip2,
            _ => Packing::Raw,
        }
    }

    /// Decompresses at most `limit` bytes; the allocation grows with the actual data.
    pub fn take(self, packed: &[u8], limit: u64) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        match self {
            Packing::Raw => packed.take(limit).read_to_end(&mut bytes),
            Packing::Gzip => MultiGzDecoder::new(packed)
                .take(limit)
                .read_to_end(&mut bytes),
            Packing::Zlib => ZlibDecoder::new(packed).take(limit).read_to_end(&mut bytes),
            Packing::Bzip2 => MultiBzDecoder::new(packed)
                .take(limit)
                .read_to_end(&mut bytes),
        }?;
        Ok(bytes)
    }
}

/// Maximum number of bytes after the voxels (a line end, or padding) that go without a note.
const MAX_PADDING_BYTES: usize = 16;

/// Decompresses the first `wanted` bytes of `packed`. The allocation grows with the actual data, not
/// with the stated size.
pub(super) fn unpack_start(packed: &[u8], packing: Packing, wanted: usize) -> ParseResult<Vec<u8>> {
    let bytes = packing
        .take(packed, wanted as u64)
        .map_err(|e| format!("cannot decompress the voxels: {e}"))?;
    match bytes.len() < wanted {
        true => Err(format!(
            "header specifies {wanted} bytes of voxels, but the file has {} (wrong size in the \
            header or truncated file)",
            bytes.len()
        )),
        false => Ok(bytes),
    }
}

/// Decompresses the `wanted` bytes of `packed`, which end with a volume of `volume` bytes. Bytes that
/// follow are left out with a note; as many as another volume indicate a wrong header.
pub(super) fn unpack(
    packed: &[u8],
    packing: Packing,
    [wanted, volume]: [usize; 2],
    notes: &mut Vec<String>,
) -> ParseResult<Vec<u8>> {
    let limit = wanted.saturating_add(volume.max(MAX_PADDING_BYTES + 1));
    let mut bytes = match packing {
        Packing::Raw => packed[..packed.len().min(limit)].to_vec(),
        _ => packing
            .take(packed, limit as u64)
            .map_err(|e| format!("cannot decompress the voxels: {e}"))?,
    };
    if bytes.len() < wanted {
        return unpack_start(&bytes, Packing::Raw, wanted);
    }
    let more = bytes.len() - wanted;
    if bytes.len() == limit {
        return Err(format!(
            "header specifies {wanted} bytes of voxels, but the file has more (wrong size in the \
            header)"
        ));
    }
    if more > MAX_PADDING_BYTES {
        notes.push(format!("{more} bytes after the voxels are ignored"));
    }
    bytes.truncate(wanted);
    Ok(bytes)
}

/// Returns the bytes of one of `count` volumes whose blocks of `block` bytes alternate: the values of
/// a voxel, or whole volumes.
pub(super) fn one_of(bytes: &[u8], block: usize, count: usize, chosen: usize) -> Vec<u8> {
    let blocks = bytes.chunks_exact(block.max(1));
    let own = blocks.skip(chosen).step_by(count.max(1));
    own.flatten().copied().collect()
}

/// Returns the number of the requested one of `count` volumes in a file; `what` says where the file
/// states their number.
pub(super) fn chosen(requested: Option<usize>, count: usize, what: &str) -> ParseResult<usize> {
    match requested {
        None if count == 1 => Ok(0),
        Some(k) if k < count => Ok(k),
        Some(k) => Err(format!(
            "there is no volume {k}: the file has {count} ({what}), so `--volume` must be in [0, \
            {}]",
            count - 1
        )),
        None => Err(format!(
            "the file has {count} volumes, not a single volume ({what}); select one with --volume \
            K, K from 0 to {} (`volume = K` in scenes and in Python)",
            count - 1
        )),
    }
}

/// Decodes voxels from binary data of exactly the right length.
pub(super) fn decode(bytes: &[u8], scalar: ScalarType, big_endian: bool) -> Raw {
    macro_rules! numbers {
        ($raw:ident, $type:ty) => {
            Raw::$raw(
                bytes
                    .chunks_exact(size_of::<$type>())
                    .map(|chunk| {
                        let mut number = [0; size_of::<$type>()];
                        number.copy_from_slice(chunk);
                        match big_endian {
                            true => <$type>::from_be_bytes(number),
                            false => <$type>::from_le_bytes(number),
                        }
                    })
                    .collect(),
            )
        };
    }
    match scalar {
        ScalarType::I8 => numbers!(I8, i8),
        ScalarType::U8 => numbers!(U8, u8),
        ScalarType::I16 => numbers!(I16, i16),
        ScalarType::U16 => numbers!(U16, u16),
        ScalarType::I32 => numbers!(I32, i32),
        ScalarType::U32 => numbers!(U32, u32),
        ScalarType::I64 => numbers!(I64, i64),
        ScalarType::U64 => numbers!(U64, u64),
        ScalarType::F32 => numbers!(F32, f32),
        ScalarType::F64 => numbers!(F64, f64),
    }
}

/// Decodes voxels written as text.
pub(super) fn decode_text(bytes: &[u8], scalar: ScalarType, voxels: usize) -> ParseResult<Raw> {
    let mut cursor = Cursor::new(bytes);
    // Every number takes at least a character and a separator.
    let voxels = cursor.validate_count(
        i64::try_from(voxels).unwrap_or(i64::MAX),
        format_args!("the number of voxels"),
        2,
    )?;
    let whole = !matches!(scalar, ScalarType::F32 | ScalarType::F64);
    macro_rules! numbers {
        ($raw:ident, $type:ty) => {{
            let mut values: Vec<$type> = Vec::with_capacity(voxels);
            for n in 0..voxels {
                let token = cursor.token().ok_or_else(|| {
                    format!("header specifies {voxels} voxels, but the text ends after {n}")
                })?;
                let parsed = std::str::from_utf8(token).ok().and_then(|t| t.parse().ok());
                values.push(match (parsed, number(token)) {
                    (Some(value), _) => value,
                    (None, Some(value)) if !whole || (value as $type) as f64 == value => {
                        value as $type
                    }
                    _ => {
                        return Err(format!(
                            "voxel {n} is {:?}, expected a number of the type in the header",
                            String::from_utf8_lossy(&token[..token.len().min(20)])
                        ));
                    }
                });
            }
            Raw::$raw(values)
        }};
    }
    Ok(match scalar {
        ScalarType::I8 => numbers!(I8, i8),
        ScalarType::U8 => numbers!(U8, u8),
        ScalarType::I16 => numbers!(I16, i16),
        ScalarType::U16 => numbers!(U16, u16),
        ScalarType::I32 => numbers!(I32, i32),
        ScalarType::U32 => numbers!(U32, u32),
        ScalarType::I64 => numbers!(I64, i64),
        ScalarType::U64 => numbers!(U64, u64),
        ScalarType::F32 => numbers!(F32, f32),
        ScalarType::F64 => numbers!(F64, f64),
    })
}
