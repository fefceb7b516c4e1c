//! Reader for VTK XML unstructured grids (`.vtu`): ASCII, inline base64, appended raw and base64,
//! with or without zlib compression, both header widths, both byte orders, several pieces.
//!
//! The `vtkio` crate (0.6.3) was tested on real files and on the output of VTK 9: it panics on
//! appended base64 of older VTK, and rejects appended raw data and compressed arrays of more than
//! one block, so this is a separate reader, based on quick-xml, base64 and flate2.

use super::cursor::ParseResult;
use super::raw_mesh::{RawMesh, index};
use super::scalar;
use super::vtk_regions::{self, Global};
use super::vtu_data::{Layout, Source, numbers};
use super::vtu_tags::{Array, array, attribute, count, layout, name_of};
use crate::mesh::{AnatomicalFrame, Field, Location, ScalarType};
use glam::DVec3;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Reads the content of a `.vtu` file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    Outline::read(bytes)?.mesh()
}

/// As [`read`]; also returns the bytes stored for the whole mesh under `name`, if any.
pub(super) fn read_telling(bytes: &[u8], name: &str) -> ParseResult<(RawMesh, Option<Vec<u8>>)> {
    let outline = Outline::read(bytes)?;
    let values = outline.global.iter().find(|(array, _)| array.name == name);
    let values = values.and_then(|(array, tuples)| outline.global_numbers(array, *tuples));
    let byte = |x: &f64| (x.fract() == 0.0 && (0.0..256.0).contains(x)).then_some(*x as u8);
    let values = values.and_then(|numbers| numbers.iter().map(byte).collect());
    Ok((outline.mesh()?, values))
}

/// The tags of the file; its data are not decoded yet.
struct Outline<'a> {
    file: &'a [u8],
    layout: Layout,
    pieces: Vec<Piece>,
    /// The arrays of the whole mesh, each with its number of tuples.
    global: Vec<(Array, Option<usize>)>,
    appended: Option<Source<'a>>,
}

#[derive(Default)]
struct Piece {
    points: usize,
    cells: usize,
    arrays: Vec<Array>,
}

impl<'a> Outline<'a> {
    fn mesh(&self) -> ParseResult<RawMesh> {
        let mut mesh = RawMesh {
            frame: AnatomicalFrame::stated_in(self.file),
            ..RawMesh::default()
        };
        self.global().add_to(&mut mesh);
        for (number, piece) in self.pieces.iter().enumerate() {
            self.add_piece(piece, number > 0, &mut mesh)
                .map_err(|e| match self.pieces.len() {
                    1 => e,
                    _ => format!("piece {number} (counted from 0): {e}"),
                })?;
        }
        Ok(mesh)
    }

    fn read(file: &'a [u8]) -> ParseResult<Outline<'a>> {
        let mut reader = Reader::from_reader(file);
        let mut outline = Outline {
            file,
            layout: Layout {
                big_endian: false,
                wide_headers: false,
                zlib: false,
            },
            pieces: Vec::new(),
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
                    outline.start(&tag, &open)?;
                    known = true;
                    open.push(name_of(&tag));
                    if tag.name().as_ref() == b"AppendedData" {
                        outline.find_appended(&tag, reader.buffer_position() as usize)?;
                        open.clear();
                        break;
                    }
                }
                Event::Empty(tag) => outline.start(&tag, &open)?,
                Event::End(_) => {
                    open.pop();
                }
                Event::Text(text) if open.iter().rev().nth(1).is_some_and(|t| t == "FieldData") => {
                    if let Some((array, _)) = outline.global.last_mut()
                        && array.text.is_empty()
                        && !text.trim_ascii().is_empty()
                    {
                        array.text = before..before + text.len();
                    }
                }
                Event::Text(text)
                    if open.last().is_some_and(|t| t == "DataArray")
                        && open.iter().rev().nth(2).is_some_and(|t| t == "Piece") =>
                {
                    if let Some(array) = outline.pieces.last_mut().and_then(|p| p.arrays.last_mut())
                        && array.text.is_empty()
                        && !text.trim_ascii().is_empty()
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

    fn start(&mut self, tag: &BytesStart, open: &[String]) -> ParseResult<()> {
        let parent = open.last().map_or("", String::as_str);
        match (name_of(tag).as_str(), parent) {
            ("VTKFile", "") => self.layout = layout(tag)?,
            (other, "") => {
                return Err(format!(
                    "expected <VTKFile> as the root element, found <{other}>"
                ));
            }
            ("Piece", "UnstructuredGrid") => self.pieces.push(Piece {
                points: count(tag, "NumberOfPoints")?,
                cells: count(tag, "NumberOfCells")?,
                arrays: Vec::new(),
            }),
            ("DataArray" | "Array", "FieldData") => {
                let array = array(tag, parent)?;
                let tuples = attribute(tag, "NumberOfTuples").and_then(|n| n.trim().parse().ok());
                self.global.push((array, tuples));
            }
            ("DataArray" | "Array", "Points" | "Cells" | "PointData" | "CellData") => {
                let array = array(tag, parent)?;
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
    fn global(&self) -> Global {
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

    /// Returns the numbers of an array of the whole mesh, if they can be read.
    fn global_numbers(&self, array: &Array, tuples: Option<usize>) -> Option<Vec<f64>> {
        if array.format != "ascii" {
            return Some(self.values(array, tuples?).ok()?.0);
        }
        // Numbers, or the bytes of strings.
        let text = String::from_utf8_lossy(&self.file[array.text.clone()]);
        let words = text.split_whitespace();
        Some(words.map_while(|word| word.parse().ok()).collect())
    }

    fn add_piece(&self, piece: &Piece, later: bool, mesh: &mut RawMesh) -> ParseResult<()> {
        let first_node = mesh.nodes.len();
        let points = piece.arrays.iter().find(|a| a.section == "Points");
        match points {
            Some(array) if array.components != 3 => {
                return Err(format!(
                    "<Points> has {} components, expected 3",
                    array.components
                ));
            }
            Some(array) => {
                let (values, _) = self.values(array, piece.points)?;
                let positions = values.as_chunks().0.iter();
                mesh.nodes.extend(positions.map(|p| DVec3::from_array(*p)));
            }
            None if piece.points == 0 => {}
            None => return Err("no coordinates in <Points>".into()),
        }
        if piece.cells > 0 {
            let of_cells = |name: &str, count: usize| {
                let array = piece
                    .arrays
                    .iter()
                    .find(|a| a.section == "Cells" && a.name == name);
                let array = array.ok_or_else(|| format!("no array \"{name}\" in <Cells>"))?;
                Ok::<_, String>(self.values(array, count)?.0)
            };
            let kinds = of_cells("types", piece.cells)?;
            let ends = ends(&of_cells("offsets", piece.cells)?)?;
            let nodes = of_cells("connectivity", ends.last().copied().unwrap_or(0))?;
            if let Some(bad) = nodes.iter().find(|v| **v >= piece.points as f64) {
                return Err(format!(
                    "array \"connectivity\" refers to node {bad}, but there are only {} nodes (counted from 0)",
                    piece.points
                ));
            }
            mesh.add_cells(&kinds, &nodes, &ends, first_node)?;
        }
        for array in &piece.arrays {
            let (location, items) = match array.section.as_str() {
                "PointData" => (Location::Node, piece.points),
                "CellData" => (Location::Cell, piece.cells),
                _ => continue,
            };
            if scalar::from_vtk_xml_name(&array.type_name).is_none() {
                mesh.warnings.push(format!(
                    "array \"{}\" skipped: its type {:?} is not numeric",
                    array.name, array.type_name
                ));
                continue;
            }
            let (values, scalar_type) = self.values(array, items)?;
            add_field(
                mesh,
                later,
                Field {
                    name: array.name.clone(),
                    location,
                    components: array.components,
                    values,
                    scalar_type,
                },
            );
        }
        Ok(())
    }

    /// Returns the numbers of an array that should have `items` tuples.
    fn values(&self, array: &Array, items: usize) -> ParseResult<(Vec<f64>, ScalarType)> {
        let inside = |e: String| format!("array \"{}\" in <{}>: {e}", array.name, array.section);
        let scalar = scalar::from_vtk_xml_name(&array.type_name)
            .ok_or_else(|| inside(format!("type {:?} is not numeric", array.type_name)))?;
        let count = items
            .checked_mul(array.components)
            .ok_or_else(|| inside("its size exceeds the addressable range".into()))?;
        let source = self.source(array).map_err(inside)?;
        Ok((
            numbers(source, self.layout, scalar, count).map_err(inside)?,
            scalar,
        ))
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

/// Adds a field, or appends to it for later pieces; a field missing in a piece is too short and is
/// dropped, with a warning, by the next stage.
fn add_field(mesh: &mut RawMesh, later: bool, field: Field) {
    let same = mesh.fields.iter_mut().find(|f| {
        later
            && (f.location, f.components) == (field.location, field.components)
            && f.name == field.name
    });
    match same {
        Some(known) => {
            if known.scalar_type != field.scalar_type {
                known.scalar_type = ScalarType::F64;
            }
            known.values.extend(field.values);
        }
        None => mesh.fields.push(field),
    }
}

/// Converts offsets to ascending ends.
fn ends(offsets: &[f64]) -> ParseResult<Vec<usize>> {
    let mut last = 0;
    offsets
        .iter()
        .enumerate()
        .map(|(cell, offset)| {
            last = index(*offset).filter(|o| *o >= last).ok_or_else(|| {
                format!("array \"offsets\": entry {cell} is {offset}, expected an integer ≥ {last}")
            })?;
            Ok(last)
        })
        .collect()
}
