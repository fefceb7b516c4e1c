//! Tags and arrays of VTK XML files of any kind: unstructured grids, surfaces, images.

use super::cursor::ParseResult;
use super::scalar;
use super::vtk_regions::{self, Global};
use super::vtu_data::{Layout, Source, numbers};
use super::vtu_tags::{Array, array, attribute, layout, name_of};
use crate::mesh::{Location, ScalarType};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::BTreeMap;

/// Sections of a piece whose arrays are read.
const SECTIONS: [&str; 8] = [
    "Points",
    "Cells",
    "Verts",
    "Lines",
    "Strips",
    "Polys",
    "PointData",
    "CellData",
];

/// The tags of the file; its data are not decoded yet.
pub(super) struct Outline<'a> {
    file: &'a [u8],
    layout: Layout,
    /// The type of the file, such as UnstructuredGrid.
    pub kind: String,
    /// The attributes of the tag of that name.
    pub dataset: BTreeMap<String, String>,
    pub pieces: Vec<Piece>,
    /// Notes about arrays that cannot be read.
    pub warnings: Vec<String>,
    /// The arrays of the whole mesh, each with its number of tuples.
    global: Vec<(Array, Option<usize>)>,
    appended: Option<Source<'a>>,
}

/// A `<Piece>` tag.
#[derive(Default)]
pub(super) struct Piece {
    attributes: BTreeMap<String, String>,
    pub arrays: Vec<Array>,
    /// Name of the array that `<PointData>` and `<CellData>` state as `Scalars`.
    pub scalars: BTreeMap<&'static str, String>,
}

impl Piece {
    /// Returns the attribute `name`, which is a number of items.
    pub fn count(&self, name: &str) -> ParseResult<usize> {
        let value = self.attributes.get(name);
        let value = value.ok_or_else(|| format!("<Piece> has no attribute {name}"))?;
        value
            .trim()
            .parse()
            .map_err(|_| format!("<Piece> has {name}=\"{value}\", expected an integer ≥ 0"))
    }

    /// Returns the attribute `name` as text.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }

    /// Returns the array `name` of a section.
    pub fn array(&self, section: &str, name: &str) -> Option<&Array> {
        let mut arrays = self.arrays.iter();
        arrays.find(|a| a.section == section && a.name == name)
    }
}

/// Returns the section of the attributes at a location.
pub(super) fn section_of(location: Location) -> &'static str {
    match location {
        Location::Node => "PointData",
        Location::Cell => "CellData",
    }
}

/// Returns the attributes of a tag.
fn attributes(tag: &BytesStart) -> BTreeMap<String, String> {
    let mut known = tag.attributes();
    known
        .with_checks(false)
        .flatten()
        .map(|a| {
            let name = String::from_utf8_lossy(a.key.as_ref()).into_owned();
            let value = attribute(tag, &name).unwrap_or_default();
            (name, value)
        })
        .collect()
}

impl<'a> Outline<'a> {
    /// Reads the tags of a file of one of the types `kinds`.
    pub fn read(file: &'a [u8], kinds: &[&str]) -> ParseResult<Outline<'a>> {
        let mut reader = Reader::from_reader(file);
        let mut outline = Outline {
            file,
            layout: Layout {
                big_endian: false,
                wide_headers: false,
                compressor: None,
            },
            kind: String::new(),
            dataset: BTreeMap::new(),
            pieces: Vec::new(),
            warnings: Vec::new(),
            global: Vec::new(),
            appended: None,
        };
        let mut open: Vec<String> = Vec::new();
        let mut known = false;
        loop {
            let before = reader.buffer_position() as usize;
            let event = reader
                .read_event()
                .map_err(|e| format!("byte {}: invalid XML: {e}", reader.error_position()))?;
            match event {
                Event::Start(tag) => {
                    outline.start(&tag, &open, kinds)?;
                    known = true;
                    open.push(name_of(&tag));
                    if tag.name().as_ref() == b"AppendedData" {
                        outline.find_appended(&tag, reader.buffer_position() as usize)?;
                        open.clear();
                        break;
                    }
                }
                Event::Empty(tag) => outline.start(&tag, &open, kinds)?,
                Event::End(_) => {
                    open.pop();
                }
                Event::Text(text) if !text.trim_ascii().is_empty() => {
                    if let Some(array) = outline.open_array(&open)
                        && array.text.is_empty()
                    {
                        array.text = before..before + text.len();
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        match open.pop() {
            Some(tag) => Err(format!("unexpected end of file within <{tag}> (truncated)")),
            None if !known => Err("no <VTKFile> in the file; expected a VTK XML file".into()),
            None if outline.pieces.is_empty() => {
                Err("no <Piece> in the file; expected a mesh".into())
            }
            None => Ok(outline),
        }
    }

    /// Returns the array to which text within the tags `open` belongs.
    fn open_array(&mut self, open: &[String]) -> Option<&mut Array> {
        let mut outwards = open.iter().rev().map(String::as_str);
        if !matches!(outwards.next()?, "DataArray" | "Array") {
            return None;
        }
        if outwards.next()? == "FieldData" {
            return Some(&mut self.global.last_mut()?.0);
        }
        match outwards.next()? {
            "Piece" => self.pieces.last_mut()?.arrays.last_mut(),
            _ => None,
        }
    }

    fn start(&mut self, tag: &BytesStart, open: &[String], kinds: &[&str]) -> ParseResult<()> {
        let parent = open.last().map_or("", String::as_str);
        let name = name_of(tag);
        match (name.as_str(), parent) {
            ("VTKFile", "") => {
                self.layout = layout(tag)?;
                self.kind = attribute(tag, "type").unwrap_or_default();
                if !kinds.contains(&self.kind.as_str()) {
                    return Err(wrong_kind(&self.kind, kinds));
                }
            }
            (other, "") => {
                return Err(format!(
                    "expected <VTKFile> as the root element, found <{other}>"
                ));
            }
            (name, "VTKFile") if name == self.kind => self.dataset = attributes(tag),
            ("Piece", parent) if parent == self.kind => self.pieces.push(Piece {
                attributes: attributes(tag),
                ..Piece::default()
            }),
            ("PointData" | "CellData", "Piece") => {
                if let (Some(piece), Some(scalars)) =
                    (self.pieces.last_mut(), attribute(tag, "Scalars"))
                {
                    let section = match name.as_str() {
                        "PointData" => section_of(Location::Node),
                        _ => section_of(Location::Cell),
                    };
                    piece.scalars.insert(section, scalars);
                }
            }
            ("DataArray" | "Array", "FieldData") => {
                let array = array(tag, parent)?;
                let tuples = attribute(tag, "NumberOfTuples").and_then(|n| n.trim().parse().ok());
                self.global.push((array, tuples));
            }
            ("DataArray" | "Array", section) if SECTIONS.contains(&section) => {
                let array = match array(tag, section) {
                    // An attribute is left out; its text must not go to the array before it.
                    Err(e) if section.ends_with("Data") => {
                        let name = attribute(tag, "Name").unwrap_or_default();
                        self.warnings.push(format!("array \"{name}\" skipped: {e}"));
                        Array::default()
                    }
                    other => other?,
                };
                if let Some(piece) = self.pieces.last_mut() {
                    piece.arrays.push(array);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Finds the appended data: they start after the first underscore and, as raw bytes are
    /// arbitrary, end at the last end tag in the file.
    fn find_appended(&mut self, tag: &BytesStart, from: usize) -> ParseResult<()> {
        const END: &[u8] = b"</AppendedData";
        let section = &self.file[from..];
        let end = section
            .windows(END.len())
            .rposition(|w| w == END)
            .filter(|end| {
                let tail = &section[*end..];
                tail.windows(10).any(|w| w == b"</VTKFile>")
            })
            .ok_or("unexpected end of file within <AppendedData> (truncated)")?;
        let start = section[..end]
            .iter()
            .position(|b| !b.is_ascii_whitespace())
            .filter(|s| section[*s] == b'_')
            .ok_or_else(|| {
                format!("byte {from}: expected an underscore before the appended data")
            })?;
        let data = &section[start + 1..end];
        self.appended = Some(match attribute(tag, "encoding").as_deref() {
            Some("raw") => Source::Raw(data),
            Some("base64") | None => Source::Base64(data),
            Some(other) => {
                return Err(format!(
                    "<AppendedData> has unknown encoding {other:?}; expected raw or base64"
                ));
            }
        });
        Ok(())
    }

    /// Reads the arrays of the whole mesh; unreadable ones are ignored.
    pub fn global(&self) -> Global {
        let mut global = Global::default();
        for (array, tuples) in &self.global {
            if !vtk_regions::is_known(&array.name) {
                continue;
            }
            if let Some(numbers) = self.global_numbers(array, *tuples) {
                global.array(&array.name, &numbers);
            }
        }
        global
    }

    /// Returns the numbers of the array `name` of the whole mesh, if there is one that can be read.
    pub fn global_array(&self, name: &str) -> Option<Vec<f64>> {
        let (array, tuples) = self.global.iter().find(|(array, _)| array.name == name)?;
        self.global_numbers(array, *tuples)
    }

    fn global_numbers(&self, array: &Array, tuples: Option<usize>) -> Option<Vec<f64>> {
        if array.format != "ascii" {
            return Some(self.values(array, Some(tuples?)).ok()?.0);
        }
        // Numbers, or the bytes of strings.
        let text = String::from_utf8_lossy(&self.file[array.text.clone()]);
        let words = text.split_whitespace();
        Some(words.map_while(|word| word.parse().ok()).collect())
    }

    /// Returns the numbers of an array that should have `items` tuples, if their number is known.
    /// Errors name the array.
    pub fn values(
        &self,
        array: &Array,
        items: Option<usize>,
    ) -> ParseResult<(Vec<f64>, ScalarType)> {
        self.attribute_values(array, items)
            .map_err(|e| format!("array \"{}\" in <{}>: {e}", array.name, array.section))
    }

    /// As [`Outline::values`]; errors do not name the array.
    pub fn attribute_values(
        &self,
        array: &Array,
        items: Option<usize>,
    ) -> ParseResult<(Vec<f64>, ScalarType)> {
        let scalar = scalar::from_vtk_xml_name(&array.type_name)
            .ok_or_else(|| format!("its type {:?} is not numeric", array.type_name))?;
        let count = match items {
            Some(items) => Some(
                items
                    .checked_mul(array.components)
                    .ok_or("its size exceeds the addressable range")?,
            ),
            None => None,
        };
        let source = self.source(array)?;
        Ok((numbers(source, self.layout, scalar, count)?, scalar))
    }

    fn source(&self, array: &Array) -> ParseResult<Source<'a>> {
        match array.format.as_str() {
            "ascii" => Ok(Source::Ascii {
                file: &self.file[..array.text.end],
                start: array.text.start,
            }),
            "binary" => Ok(Source::Base64(&self.file[array.text.clone()])),
            "appended" => {
                let offset = array
                    .offset
                    .ok_or("appended array has no attribute offset")?;
                let from = |data: &'a [u8]| {
                    data.get(offset..).ok_or_else(|| {
                        format!(
                            "its offset {offset} lies beyond the {} bytes of appended data",
                            data.len()
                        )
                    })
                };
                match self.appended {
                    Some(Source::Raw(data)) => Ok(Source::Raw(from(data)?)),
                    Some(Source::Base64(data)) => Ok(Source::Base64(from(data)?)),
                    _ => Err("appended array, but no <AppendedData> in the file".into()),
                }
            }
            other => Err(format!(
                "unknown format {other:?}; expected ascii, binary or appended"
            )),
        }
    }
}

/// Returns the error of a file of another type than `kinds`.
fn wrong_kind(kind: &str, kinds: &[&str]) -> String {
    let help = match kind {
        "ImageData" => "it is an image on a regular grid, which is read as a volume",
        "PolyData" => "it is a surface",
        "UnstructuredGrid" => "it is a mesh of cells",
        _ => "convert it to .vtu with ParaView (filter Append Datasets, then File > Save Data)",
    };
    let kinds: Vec<String> = kinds.iter().map(|k| format!("{k:?}")).collect();
    format!(
        "VTK file contains {kind:?}, expected {}; {help}",
        kinds.join(" or ")
    )
}
