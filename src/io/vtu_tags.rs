//! Tags of VTK XML files: attributes, layouts, arrays.

use super::cursor::ParseResult;
use super::vtu_data::{Compressor, Layout};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Calls `each` for every opening tag of an XML file.
///
/// # Errors
/// Invalid XML, a truncated file, or an error of `each`.
pub(super) fn for_each_tag(
    bytes: &[u8],
    mut each: impl FnMut(&BytesStart) -> ParseResult<()>,
) -> ParseResult<()> {
    let mut reader = Reader::from_reader(bytes);
    let mut depth = 0usize;
    loop {
        let event = reader
            .read_event()
            .map_err(|e| format!("byte {}: invalid XML: {e}", reader.error_position()))?;
        match &event {
            Event::Start(tag) => {
                depth += 1;
                each(tag)?;
            }
            Event::Empty(tag) => each(tag)?,
            Event::End(_) => depth = depth.saturating_sub(1),
            Event::Eof if depth > 0 => return Err("unexpected end of file (truncated)".into()),
            Event::Eof => return Ok(()),
            _ => {}
        }
    }
}

/// A `<DataArray>` tag.
#[derive(Default)]
pub(super) struct Array {
    /// The enclosing tag, such as Points or PointData.
    pub section: String,
    pub name: String,
    pub type_name: String,
    pub components: usize,
    pub format: String,
    pub offset: Option<usize>,
    /// The range of its own text in the file.
    pub text: std::ops::Range<usize>,
}

/// Parses a `<DataArray>` tag in `section`.
pub(super) fn array(tag: &BytesStart, section: &str) -> ParseResult<Array> {
    Ok(Array {
        section: section.to_string(),
        name: attribute(tag, "Name").unwrap_or_else(|| "unnamed".into()),
        type_name: attribute(tag, "type").unwrap_or_default(),
        components: match attribute(tag, "NumberOfComponents") {
            None => 1,
            Some(_) => count(tag, "NumberOfComponents")?,
        },
        format: attribute(tag, "format").unwrap_or_else(|| "ascii".into()),
        offset: match attribute(tag, "offset") {
            None => None,
            Some(_) => Some(count(tag, "offset")?),
        },
        text: 0..0,
    })
}

/// Parses the encoding of the data in the first tag of a file.
pub(super) fn layout(tag: &BytesStart) -> ParseResult<Layout> {
    let compressor = attribute(tag, "compressor").unwrap_or_default();
    Ok(Layout {
        big_endian: match attribute(tag, "byte_order").as_deref() {
            Some("LittleEndian") | None => false,
            Some("BigEndian") => true,
            Some(other) => {
                return Err(format!(
                    "unknown byte_order {other:?}; expected LittleEndian \
                or BigEndian"
                ));
            }
        },
        wide_headers: match attribute(tag, "header_type").as_deref() {
            Some("UInt32") | None => false,
            Some("UInt64") => true,
            Some(other) => {
                return Err(format!(
                    "unknown header_type {other:?}; expected UInt32 or \
                UInt64"
                ));
            }
        },
        compressor: match compressor.as_str() {
            "" => None,
            "vtkZLibDataCompressor" => Some(Compressor::Zlib),
            "vtkLZ4DataCompressor" => Some(Compressor::Lz4),
            "vtkLZMADataCompressor" => Some(Compressor::Lzma),
            other => {
                return Err(format!(
                    "compressor {other} is not supported; use vtkZLibDataCompressor, \
                    vtkLZ4DataCompressor, vtkLZMADataCompressor or none (in ParaView, save with \
                    compressor ZLib)"
                ));
            }
        },
    })
}

pub(super) fn name_of(tag: &BytesStart) -> String {
    String::from_utf8_lossy(tag.name().as_ref()).into_owned()
}

/// Returns the value of an attribute. VTK does not escape values as XML requires, so a value that
/// cannot be unescaped is used as it is.
pub(super) fn attribute(tag: &BytesStart, name: &str) -> Option<String> {
    let attribute = tag.try_get_attribute(name).ok()??;
    Some(match attribute.unescape_value() {
        Ok(value) => value.into_owned(),
        Err(_) => String::from_utf8_lossy(&attribute.value).into_owned(),
    })
}

pub(super) fn count(tag: &BytesStart, name: &str) -> ParseResult<usize> {
    let value = attribute(tag, name)
        .ok_or_else(|| format!("<{}> has no attribute {name}", name_of(tag)))?;
    value.trim().parse().map_err(|_| {
        format!(
            "<{}> has {name}=\"{value}\", expected an integer ≥ 0",
            name_of(tag)
        )
    })
}
