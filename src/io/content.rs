//! The content of a file as all readers get it: decompressed from gzip, and text as UTF-8 without
//! byte order mark, its lines ended by `\n`.

use super::volume;
use crate::{Error, Result, files};
use flate2::read::MultiGzDecoder;
use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

/// The byte order mark that Windows programs put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Magic bytes of gzip.
const GZIP: &[u8] = b"\x1f\x8b";

/// Number of characters by which UTF-16 without a byte order mark is recognised.
const UTF16_START: usize = 8;

/// Returns the decoded content of a regular, non-empty file: see [`decoded`].
pub(super) fn content(path: &Path) -> Result<Vec<u8>> {
    let bytes = files::read_regular(path)?;
    Ok(match content_of(path, &bytes)? {
        // Files can be large, so an unchanged one is not copied.
        Cow::Borrowed(same) if same.len() == bytes.len() => bytes,
        other => other.into_owned(),
    })
}

/// Returns `bytes`, the content of `path`, decoded; it must not be empty.
pub(super) fn content_of<'a>(path: &Path, bytes: &'a [u8]) -> Result<Cow<'a, [u8]>> {
    let bytes = decoded(bytes).map_err(|e| Error::format(path, e))?;
    match bytes.trim_ascii().is_empty() {
        true => Err(Error::format(path, "file is empty")),
        false => Ok(bytes),
    }
}

/// Decodes the bytes of a file: gzip, UTF-16, the byte order mark, and lines that end with `\r`
/// alone. Volumes compressed as a whole stay so, since their readers decompress as much as they
/// need.
///
/// # Errors
/// A sentence for a damaged gzip file.
pub(super) fn decoded(bytes: &[u8]) -> std::result::Result<Cow<'_, [u8]>, String> {
    if !bytes.starts_with(GZIP) || volume::is_volume(bytes, "") {
        return Ok(text(bytes));
    }
    let mut inner = Vec::new();
    MultiGzDecoder::new(bytes)
        .read_to_end(&mut inner)
        .map_err(|e| format!("cannot decompress the file with gzip: {e}"))?;
    let changed = match text(&inner) {
        Cow::Borrowed(same) if same.len() == inner.len() => None,
        other => Some(other.into_owned()),
    };
    Ok(Cow::Owned(changed.unwrap_or(inner)))
}

/// Decodes text; other bytes are returned as they are.
fn text(bytes: &[u8]) -> Cow<'_, [u8]> {
    let bytes = match utf8_of_utf16(bytes) {
        Some(text) => Cow::Owned(text.into_bytes()),
        None => Cow::Borrowed(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)),
    };
    if !ends_lines_with_cr(&bytes) {
        return bytes;
    }
    let mut bytes = bytes.into_owned();
    for byte in bytes.iter_mut().filter(|b| **b == b'\r') {
        *byte = b'\n';
    }
    Cow::Owned(bytes)
}

/// Whether this is text whose lines all end with `\r` alone.
fn ends_lines_with_cr(bytes: &[u8]) -> bool {
    // The first test ends at the first line of any other file.
    !bytes.contains(&b'\n')
        && bytes.contains(&b'\r')
        && bytes.iter().all(|b| *b >= b' ' || is_text_control(*b))
}

/// Whether text may contain this control character: tabs, ends of lines and pages, and the end of
/// file of DOS.
fn is_text_control(byte: u8) -> bool {
    matches!(byte, b'\t'..=b'\r' | 0x1a)
}

/// Returns the text of a UTF-16 file with a byte order mark, or one that begins with ASCII
/// characters; `None` for other files.
fn utf8_of_utf16(bytes: &[u8]) -> Option<String> {
    let (pairs, _) = bytes.as_chunks::<2>();
    let start = &pairs[..pairs.len().min(UTF16_START)];
    let is_ascii = |b: u8| (b' '..=b'~').contains(&b) || is_text_control(b);
    let (pairs, big_endian) = match pairs.first()? {
        [0xff, 0xfe] => (&pairs[1..], false),
        [0xfe, 0xff] => (&pairs[1..], true),
        _ if start.len() < UTF16_START => return None,
        _ if start.iter().all(|[low, high]| is_ascii(*low) && *high == 0) => (pairs, false),
        _ if start.iter().all(|[high, low]| is_ascii(*low) && *high == 0) => (pairs, true),
        _ => return None,
    };
    let unit = |pair: &[u8; 2]| match big_endian {
        true => u16::from_be_bytes(*pair),
        false => u16::from_le_bytes(*pair),
    };
    // Binary files may begin with the bytes of the mark, but contain zeros.
    let text: String = char::decode_utf16(pairs.iter().map(unit))
        .collect::<std::result::Result<_, _>>()
        .ok()?;
    (!text.contains('\0')).then_some(text)
}
