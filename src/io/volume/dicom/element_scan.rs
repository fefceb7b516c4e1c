//! Pre-parser of a DICOM file that checks every length against the size of the file.
//!
//! The crate that parses the values allocates as many bytes as a length states, and recurses into
//! nested sequences; so it receives only the few elements that define a slice, with checked
//! lengths.

use crate::io::cursor::ParseResult;
use dicom_core::{DataDictionary, VR};
use dicom_object::{StandardDataDictionary, Tag};

/// Offset of the first element: after the preamble and `DICM`.
const FIRST: usize = 132;
/// Value of an undefined length.
const UNDEFINED: u32 = u32::MAX;
/// Maximum nesting depth of sequences and items.
const MAX_NESTING: usize = 64;

const META_LENGTH: Tag = Tag(0x0002, 0x0000);
const TRANSFER_SYNTAX: Tag = Tag(0x0002, 0x0010);
const PIXELS: Tag = Tag(0x7fe0, 0x0010);
/// The sequences of a multi-frame image: what all frames share, and an item per frame.
const SHARED: Tag = Tag(0x5200, 0x9229);
const PER_FRAME: Tag = Tag(0x5200, 0x9230);
const ITEM: Tag = Tag(0xfffe, 0xe000);
const END_OF_ITEM: Tag = Tag(0xfffe, 0xe00d);
const END_OF_SEQUENCE: Tag = Tag(0xfffe, 0xe0dd);

/// Container of elements.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A list of items.
    Sequence,
    /// A list of blocks of bytes.
    Blocks,
    /// A list of elements.
    Item,
}

/// An open container of elements.
struct Frame {
    tag: Tag,
    kind: Kind,
    /// Number of items so far.
    items: usize,
    /// Its end, if its length is defined.
    end: Option<usize>,
    /// Whether its elements have implicit types.
    implicit: bool,
}

/// Encoding of the data set.
#[derive(Clone, Copy)]
struct Syntax {
    implicit: bool,
    big_endian: bool,
}

/// An element in the functional groups of a multi-frame image, which is text.
pub(super) struct GroupElement {
    /// Its frame; `None` if it applies to all of them.
    pub frame: Option<usize>,
    pub tag: Tag,
    pub text: String,
}

/// What a file contains.
pub(super) struct Extracted {
    /// Transfer syntax.
    pub syntax: String,
    /// A file with only the elements wanted, for the parser.
    pub sifted: Vec<u8>,
    pub groups: Vec<GroupElement>,
}

/// Checks all lengths in `file`, and that containers are closed. Returns the elements `wanted`, and
/// those `in_groups` of multi-frame images.
pub(super) fn extract_elements(
    file: &[u8],
    wanted: &[Tag],
    in_groups: &[Tag],
) -> ParseResult<Extracted> {
    let (uid, mut at) = meta_data(file)?;
    if uid == "1.2.840.10008.1.2.1.99" {
        return Err("deflated transfer syntax is not supported; convert with `dcmconv +te`".into());
    }
    let syntax = Syntax {
        implicit: uid == "1.2.840.10008.1.2",
        big_endian: uid == "1.2.840.10008.1.2.2",
    };
    let mut scan = ElementScan {
        file,
        wanted,
        in_groups,
        sifted: heading(&uid),
        groups: Vec::new(),
        seen: Vec::new(),
        blocks_begin: None,
        frames: Vec::new(),
    };
    while at + 8 <= file.len() {
        at = scan.element(at, syntax)?;
    }
    match scan.blocks_begin {
        None => Ok(Extracted {
            syntax: uid,
            sifted: scan.sifted,
            groups: scan.groups,
        }),
        Some(begin) => Err(format!(
            "byte {begin}: fragments of {PIXELS} are not terminated (truncated file)"
        )),
    }
}

/// What is known of a file up to an element.
struct ElementScan<'a> {
    file: &'a [u8],
    wanted: &'a [Tag],
    in_groups: &'a [Tag],
    groups: Vec<GroupElement>,
    /// The file with only the elements found so far.
    sifted: Vec<u8>,
    seen: Vec<Tag>,
    /// Start of the pixel data, while its blocks are open.
    blocks_begin: Option<usize>,
    /// The open containers.
    frames: Vec<Frame>,
}

impl ElementScan<'_> {
    /// Checks the element at `start`, or the start of it if it contains others. Returns where the
    /// next one starts.
    /// Long because an element has many encodings.
    fn element(&mut self, start: usize, syntax: Syntax) -> ParseResult<usize> {
        while self.frames.last().is_some_and(|f| f.end == Some(start)) {
            self.frames.pop();
        }
        let implicit = syntax.implicit || self.frames.last().is_some_and(|f| f.implicit);
        let (tag, vr, length, header) = element(self.file, start, implicit, syntax.big_endian)?;
        let at = start + header;
        let around = self.frames.iter().rev().find_map(|f| f.end);
        let end = fits(self.file, start, tag, length, at, around)?;
        if end.is_some() && !length.is_multiple_of(width(vr)) {
            return Err(format!(
                "byte {start}: element {tag} has {length} bytes, expected a multiple of {} (the \
                size of its type)",
                width(vr)
            ));
        }
        let chosen = self.frames.is_empty()
            && self.wanted.contains(&tag)
            && !self.seen.contains(&tag)
            && vr != VR::SQ
            && vr != VR::UN;
        let inside = self.frames.last().map(|f| f.kind);
        let delimits = self.frames.last().is_some_and(|f| f.end.is_none());
        let kind = match (tag, inside) {
            (END_OF_ITEM, Some(Kind::Item)) if delimits && length == 0 => {
                self.frames.pop();
                return Ok(at);
            }
            (END_OF_SEQUENCE, Some(Kind::Sequence | Kind::Blocks)) if delimits && length == 0 => {
                self.frames.pop();
                if let Some(begin) = self.blocks_begin.take_if(|_| self.frames.is_empty()) {
                    self.sifted.extend_from_slice(&self.file[begin..at]);
                }
                return Ok(at);
            }
            (ITEM, Some(Kind::Sequence)) => Kind::Item,
            (ITEM, Some(Kind::Blocks)) if end.is_some() => return Ok(end.unwrap_or(at)),
            _ if tag.group() == ITEM.group() || !matches!(inside, None | Some(Kind::Item)) => {
                return Err(format!(
                    "byte {start}: unexpected element {tag} at this nesting level"
                ));
            }
            _ if vr == VR::SQ => Kind::Sequence,
            _ => match end {
                Some(end) => {
                    if chosen {
                        self.seen.push(tag);
                        self.sifted.extend_from_slice(&self.file[start..end]);
                    } else if self.in_groups.contains(&tag) {
                        let bytes = &self.file[at..end];
                        self.groups.extend(in_group(&self.frames, tag, bytes));
                    }
                    return Ok(end);
                }
                None if tag == PIXELS => {
                    if chosen {
                        self.seen.push(tag);
                        self.blocks_begin = Some(start);
                    }
                    Kind::Blocks
                }
                None => Kind::Sequence,
            },
        };
        if let Some(around) = self.frames.last_mut().filter(|_| tag == ITEM) {
            around.items += 1;
        }
        self.frames.push(Frame {
            tag,
            kind,
            items: 0,
            end,
            // A sequence of unknown type has elements with implicit types.
            implicit: implicit || (vr == VR::UN && kind == Kind::Sequence),
        });
        if self.frames.len() > MAX_NESTING {
            return Err(format!(
                "byte {start}: sequences are nested more than {MAX_NESTING} deep"
            ));
        }
        Ok(at)
    }
}

/// Returns an element inside `frames`, if these are functional groups.
fn in_group(frames: &[Frame], tag: Tag, bytes: &[u8]) -> Option<GroupElement> {
    let outer = frames.first()?;
    let frame = match outer.tag {
        SHARED => None,
        PER_FRAME => Some(outer.items.checked_sub(1)?),
        _ => return None,
    };
    let text = String::from_utf8_lossy(bytes);
    let text = text.trim_matches(['\0', ' ']).to_owned();
    Some(GroupElement { frame, tag, text })
}

/// Returns the start of a file with that transfer syntax.
fn heading(uid: &str) -> Vec<u8> {
    let mut elements = b"\x02\0\x01\0OB\0\0\x02\0\0\0\0\x01".to_vec();
    for (number, text) in [(2, "1.2"), (3, "1.2"), (0x10, uid), (0x12, "1.2")] {
        let padded = text.len().next_multiple_of(2);
        elements.extend([2, 0, number, 0, b'U', b'I', padded as u8, 0]);
        elements.extend(text.bytes());
        elements.resize(elements.len() + padded - text.len(), 0);
    }
    let mut file = vec![0; FIRST - 4];
    file.extend(b"DICM\x02\0\0\0UL\x04\0");
    file.extend((elements.len() as u32).to_le_bytes());
    file.extend(elements);
    file
}

/// Returns the transfer syntax in the meta data, which are always little-endian with explicit
/// types, and the offset of the data set.
fn meta_data(file: &[u8]) -> ParseResult<(String, usize)> {
    let mut at = FIRST;
    let mut end = None;
    let mut uid = String::new();
    while end.is_none_or(|end| at < end) {
        let start = at;
        let (tag, _, length, header) = element(file, at, false, false)?;
        at += header;
        let value = fits(file, start, tag, length, at, None)?
            .ok_or_else(|| format!("byte {start}: element {tag} must have a defined length"))?;
        let bytes = &file[at..value];
        at = value;
        match (tag, end) {
            (META_LENGTH, None) => {
                let bytes: [u8; 4] = bytes
                    .try_into()
                    .map_err(|_| "the length of the file meta information must have 4 bytes")?;
                end = Some(at.saturating_add(u32::from_le_bytes(bytes) as usize));
            }
            (_, None) => {
                return Err(format!(
                    "byte {FIRST}: file meta information must begin with its length {META_LENGTH}, \
                    got {tag}"
                ));
            }
            (TRANSFER_SYNTAX, _) => {
                let text = String::from_utf8_lossy(bytes);
                uid = text.trim_end_matches(['\0', ' ']).to_owned();
                if uid.len() > 64 {
                    return Err(format!(
                        "byte {start}: `TransferSyntaxUID` must have at most 64 characters, got {}",
                        uid.len()
                    ));
                }
            }
            _ => {}
        }
    }
    Ok((uid, at))
}

/// Returns the end of an element of that length; `None` if the length is undefined. The value
/// begins at `at`, `around` is the end of its container.
fn fits(
    file: &[u8],
    start: usize,
    tag: Tag,
    length: u32,
    at: usize,
    around: Option<usize>,
) -> ParseResult<Option<usize>> {
    if length == UNDEFINED {
        return Ok(None);
    }
    let left = around.unwrap_or(file.len()).saturating_sub(at);
    if length as usize > left {
        let what = match around {
            Some(_) => "the enclosing sequence ends",
            None => "the file ends",
        };
        return Err(format!(
            "byte {start}: element {tag} states {length} bytes, but {what} after {left} (invalid \
            length or truncated file)"
        ));
    }
    Ok(Some(at + length as usize))
}

/// Returns the size of one value of a type in bytes.
fn width(vr: VR) -> u32 {
    match vr {
        VR::OW | VR::SS | VR::US => 2,
        VR::AT | VR::FL | VR::OF | VR::OL | VR::SL | VR::UL => 4,
        VR::FD | VR::OD | VR::OV | VR::SV | VR::UV => 8,
        _ => 1,
    }
}

/// Parses the element at byte `at`: its tag, type, length, and the size of these.
fn element(
    file: &[u8],
    at: usize,
    implicit: bool,
    big: bool,
) -> ParseResult<(Tag, VR, u32, usize)> {
    let bytes = file.get(at..).unwrap_or_default();
    let short = |n: usize| match (bytes.get(n), bytes.get(n + 1)) {
        (Some(a), Some(b)) if big => Ok(u16::from_be_bytes([*a, *b])),
        (Some(a), Some(b)) => Ok(u16::from_le_bytes([*a, *b])),
        _ => Err(format!("byte {at}: the file ends inside an element")),
    };
    let long = |n: usize| -> ParseResult<u32> {
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
    let [Some(first), Some(second)] = [bytes.get(4), bytes.get(5)] else {
        return Err(format!("byte {at}: the file ends inside an element"));
    };
    let vr = VR::from_binary([*first, *second]).unwrap_or(VR::UN);
    Ok(match vr {
        VR::OB | VR::OD | VR::OF | VR::OL | VR::OV | VR::OW | VR::SQ | VR::SV => {
            (tag, vr, long(8)?, 12)
        }
        VR::UC | VR::UN | VR::UR | VR::UT | VR::UV => (tag, vr, long(8)?, 12),
        _ => (tag, vr, short(6)?.into(), 8),
    })
}
