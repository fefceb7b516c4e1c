//! A walk along the elements of a DICOM file, which holds every length against the file.
//!
//! The crate that parses the values makes room for as many bytes as a length says, and descends
//! into nested sequences by calling itself; so both are checked before it sees a file.

use crate::io::cursor::Parse;
use dicom_core::{DataDictionary, VR};
use dicom_object::{StandardDataDictionary, Tag};

/// Where the first element lies: after the preamble and `DICM`.
const FIRST: usize = 132;
/// A length that is not known beforehand.
const UNDEFINED: u32 = u32::MAX;
/// The deepest nesting of sequences and items.
const DEEPEST: usize = 64;

const TRANSFER_SYNTAX: Tag = Tag(0x0002, 0x0010);
const PIXELS: Tag = Tag(0x7fe0, 0x0010);
const ITEM: Tag = Tag(0xfffe, 0xe000);
const END_OF_ITEM: Tag = Tag(0xfffe, 0xe00d);
const END_OF_SEQUENCE: Tag = Tag(0xfffe, 0xe0dd);

/// Something that elements lie in.
struct Frame {
    /// The end, where its length is defined.
    end: Option<usize>,
    /// Whether its items are blocks of bytes, not elements.
    blocks: bool,
    /// Whether elements in it name no type.
    implicit: bool,
}

/// How the data set is written.
#[derive(Clone, Copy)]
struct Syntax {
    implicit: bool,
    big_endian: bool,
}

/// Checks all lengths in `file`; returns its transfer syntax.
pub(super) fn check(file: &[u8]) -> Parse<String> {
    let mut uid = String::new();
    let mut syntax = Syntax {
        implicit: false,
        big_endian: false,
    };
    let mut in_meta = true;
    let mut frames: Vec<Frame> = Vec::new();
    let mut at = FIRST;
    while at + 8 <= file.len() {
        while frames
            .last()
            .is_some_and(|f| f.end.is_some_and(|e| e <= at))
        {
            frames.pop();
        }
        // The group of the meta data is always little-endian with types.
        if in_meta && file[at..at + 2] != [2, 0] {
            in_meta = false;
            syntax.implicit = uid == "1.2.840.10008.1.2";
            syntax.big_endian = uid == "1.2.840.10008.1.2.2";
            if uid == "1.2.840.10008.1.2.1.99" {
                return Err(
                    "the transfer syntax is deflated, which is not read; `dcmconv +te` converts"
                        .into(),
                );
            }
        }
        let implicit = syntax.implicit || frames.last().is_some_and(|f| f.implicit);
        let (tag, vr, length, header) = element(file, at, implicit, syntax.big_endian)?;
        let start = at;
        at += header;
        let around = frames.iter().rev().find_map(|f| f.end);
        let left = around.unwrap_or(file.len()).saturating_sub(at);
        if length != UNDEFINED && length as usize > left {
            let what = match around {
                Some(_) => "the sequence around it ends",
                None => "the file ends",
            };
            return Err(format!(
                "byte {start}: the element {tag} is said to have {length} bytes, but {what} after {left} (lying length or truncated file)"
            ));
        }
        let end = (length != UNDEFINED).then(|| at + length as usize);
        let blocks = frames.last().is_some_and(|f| f.blocks);
        match tag {
            END_OF_ITEM | END_OF_SEQUENCE => {
                frames.pop();
                continue;
            }
            ITEM if !blocks => frames.push(Frame {
                end,
                blocks: false,
                implicit,
            }),
            _ if vr == VR::SQ || end.is_none() => frames.push(Frame {
                end,
                blocks: tag == PIXELS,
                // A sequence of unknown type holds elements without types.
                implicit: implicit || vr == VR::UN,
            }),
            _ => {
                if tag == TRANSFER_SYNTAX {
                    let value = &file[at..at + length as usize];
                    let text = String::from_utf8_lossy(value);
                    uid = text.trim_end_matches(['\0', ' ']).to_owned();
                }
                at += length as usize;
            }
        }
        if frames.len() > DEEPEST {
            return Err(format!(
                "byte {start}: sequences are nested more than {DEEPEST} deep"
            ));
        }
    }
    Ok(uid)
}

/// The element at byte `at`: its tag, type, length, and the bytes of these.
fn element(file: &[u8], at: usize, implicit: bool, big: bool) -> Parse<(Tag, VR, u32, usize)> {
    let bytes = &file[at..];
    let short = |n: usize| match (bytes.get(n), bytes.get(n + 1)) {
        (Some(a), Some(b)) if big => Ok(u16::from_be_bytes([*a, *b])),
        (Some(a), Some(b)) => Ok(u16::from_le_bytes([*a, *b])),
        _ => Err(format!("byte {at}: the file ends inside an element")),
    };
    let long = |n: usize| -> Parse<u32> {
        let [first, second] = [u32::from(short(n)?), u32::from(short(n + 2)?)];
        Ok(match big {
            true => first << 16 | second,
            false => second << 16 | first,
        })
    };
    let tag = Tag(short(0)?, short(2)?);
    if tag.group() == ITEM.group() {
        return Ok((tag, VR::UN, long(4)?, 8));
    }
    if implicit {
        let known = StandardDataDictionary.by_tag(tag);
        let vr = known.map_or(VR::UN, |entry| entry.vr.relaxed());
        return Ok((tag, vr, long(4)?, 8));
    }
    let vr = VR::from_binary([bytes[4], bytes[5]]).unwrap_or(VR::UN);
    Ok(match vr {
        VR::OB | VR::OD | VR::OF | VR::OL | VR::OV | VR::OW | VR::SQ | VR::SV => {
            (tag, vr, long(8)?, 12)
        }
        VR::UC | VR::UN | VR::UR | VR::UT | VR::UV => (tag, vr, long(8)?, 12),
        _ => (tag, vr, short(6)?.into(), 8),
    })
}
