//! Reader for PLY: ASCII, and binary of both byte orders.
//!
//! Vertex properties other than x, y, z become fields. Properties and elements of any other kind
//! are skipped.

use crate::io::cursor::{Cursor, ParseResult};
use crate::io::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, ScalarType};
use glam::DVec3;

/// Magic bytes of the format.
pub(super) const MAGIC: &[u8] = b"ply";

/// VTK number of a polygon.
const POLYGON: u8 = 7;
/// Maximum number of corners of a polygon; more indicate a damaged file.
const MAX_CORNERS: usize = 1 << 16;

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// A property of an element: a number, or a list preceded by its count.
struct Property {
    name: String,
    scalar: ScalarType,
    count: Option<ScalarType>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads the content of a PLY file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::new(bytes);
    let (encoding, elements) = header(&mut at)?;
    at.binary = encoding != Encoding::Ascii;
    // Where every element has its own line, a line may have more values than the header declares.
    let total: usize = elements
        .iter()
        .map(|e| e.count)
        .fold(0, usize::saturating_add);
    let by_lines = encoding == Encoding::Ascii && {
        let lines = at.rest().split(|b| *b == b'\n');
        let lines = lines.filter(|line| !line.trim_ascii().is_empty());
        lines.take(total).count() == total
    };
    let mut body = Body {
        at,
        encoding,
        by_lines,
        long_lines: 0,
    };
    let mut mesh = RawMesh::default();
    for element in &elements {
        let least: usize = element.properties.iter().map(|p| p.least(encoding)).sum();
        let count = i64::try_from(element.count).unwrap_or(i64::MAX);
        body.at.validate_count(
            count,
            format_args!("the number of elements \"{}\"", element.name),
            least.max(1),
        )?;
        match element.name.as_str() {
            "vertex" => body.vertices(element, &mut mesh)?,
            "face" => body.faces(element, &mut mesh)?,
            "tristrips" => body.strips(element, &mut mesh)?,
            _ => body.pass_over(element)?,
        }
    }
    if body.long_lines > 0 {
        mesh.warnings.push(format!(
            "{} lines have more values than the header declares; these are ignored",
            body.long_lines
        ));
    }
    Ok(mesh)
}

fn header(at: &mut Cursor) -> ParseResult<(Encoding, Vec<Element>)> {
    at.rest_of_line(); // ply
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let start = at.position();
        if at.rest().is_empty() {
            return Err("unexpected end of file in the header, expected end_header".into());
        }
        let line = String::from_utf8_lossy(at.rest_of_line()).into_owned();
        let words: Vec<&str> = line.split_whitespace().collect();
        let wrong = |what: &str| at.error_at(start, format_args!("{what}, found {line:?}"));
        match words[..] {
            ["format", name, _] => {
                encoding = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => {
                        return Err(wrong(
                            "expected format ascii, binary_little_endian or binary_big_endian",
                        ));
                    }
                });
            }
            ["element", name, count] => elements.push(Element {
                name: name.into(),
                count: count
                    .parse()
                    .map_err(|_| wrong("expected a number of elements"))?,
                properties: Vec::new(),
            }),
            ["property", ref kind @ .., name] => {
                let scalar =
                    |word: &str| scalar_type(word).ok_or_else(|| wrong("expected a number type"));
                let (count, scalar) = match *kind {
                    [one] => (None, scalar(one)?),
                    ["list", count, item] => (Some(scalar(count)?), scalar(item)?),
                    _ => return Err(wrong("expected \"property TYPE NAME\" or a list")),
                };
                let last = elements.last_mut();
                let last = last.ok_or_else(|| wrong("expected an element before a property"))?;
                last.properties.push(Property {
                    name: name.into(),
                    scalar,
                    count,
                });
            }
            ["end_header"] => break,
            ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(wrong("expected format, element, property or end_header")),
        }
    }
    let encoding = encoding.ok_or("header has no \"format\" line")?;
    Ok((encoding, elements))
}

fn scalar_type(word: &str) -> Option<ScalarType> {
    Some(match word {
        "char" | "int8" => ScalarType::I8,
        "uchar" | "uint8" => ScalarType::U8,
        "short" | "int16" => ScalarType::I16,
        "ushort" | "uint16" => ScalarType::U16,
        "int" | "int32" => ScalarType::I32,
        "uint" | "uint32" => ScalarType::U32,
        "float" | "float32" => ScalarType::F32,
        "double" | "float64" => ScalarType::F64,
        _ => return None,
    })
}

impl Property {
    /// Returns the minimum size of an item in bytes.
    fn least(&self, encoding: Encoding) -> usize {
        match encoding {
            Encoding::Ascii => 2,
            _ => bytes_in(self.count.unwrap_or(self.scalar)),
        }
    }
}

fn bytes_in(scalar: ScalarType) -> usize {
    match scalar {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::I64 | ScalarType::U64 | ScalarType::F64 => 8,
    }
}

/// The data after the header.
struct Body<'a> {
    at: Cursor<'a>,
    encoding: Encoding,
    /// Whether every element has its own line of text.
    by_lines: bool,
    /// Number of lines with more values than the header declares.
    long_lines: usize,
}

impl Body<'_> {
    fn number(&mut self, scalar: ScalarType, of: &str) -> ParseResult<f64> {
        if self.encoding == Encoding::Ascii {
            return self.at.number(format_args!("{of}"));
        }
        let mut bytes = [0; 8];
        let length = bytes_in(scalar);
        bytes[..length].copy_from_slice(self.at.take(length, format_args!("{of}"))?);
        if self.encoding == Encoding::Big {
            bytes[..length].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(match scalar {
            ScalarType::I8 => f64::from(a as i8),
            ScalarType::U8 => f64::from(a),
            ScalarType::I16 => f64::from(i16::from_le_bytes([a, b])),
            ScalarType::U16 => f64::from(u16::from_le_bytes([a, b])),
            ScalarType::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            ScalarType::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            ScalarType::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            ScalarType::F64 => f64::from_le_bytes(bytes),
            ScalarType::I64 => i64::from_le_bytes(bytes) as f64,
            ScalarType::U64 => u64::from_le_bytes(bytes) as f64,
        })
    }

    /// Reads the items of a property: one, or those of a list.
    fn items(&mut self, property: &Property) -> ParseResult<Vec<f64>> {
        let count = match property.count {
            None => 1,
            Some(count) => {
                let length = self.number(count, &property.name)?;
                let least = match self.encoding {
                    Encoding::Ascii => 1,
                    _ => bytes_in(property.scalar),
                };
                let whole = length.fract() == 0.0 && length >= 0.0;
                let length = if whole { length as i64 } else { -1 };
                let what = format_args!("the length of list \"{}\"", property.name);
                self.at.validate_count(length, what, least)?
            }
        };
        (0..count)
            .map(|_| self.number(property.scalar, &property.name))
            .collect()
    }

    /// Moves to the next line after the last value of an element, if each has its own.
    fn end_element(&mut self) {
        if self.by_lines && !self.at.rest_of_line().trim_ascii().is_empty() {
            self.long_lines += 1;
        }
    }

    fn pass_over(&mut self, element: &Element) -> ParseResult<()> {
        for _ in 0..element.count {
            for property in &element.properties {
                self.items(property)?;
            }
            self.end_element();
        }
        Ok(())
    }

    fn vertices(&mut self, element: &Element, mesh: &mut RawMesh) -> ParseResult<()> {
        let place = |name: &str| element.properties.iter().position(|p| p.name == name);
        let (Some(x), Some(y), Some(z)) = (place("x"), place("y"), place("z")) else {
            return Err("vertices must have the properties x, y and z".into());
        };
        // Scalar properties other than the position become fields.
        let kept: Vec<usize> = (0..element.properties.len())
            .filter(|n| ![x, y, z].contains(n) && element.properties[*n].count.is_none())
            .collect();
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); kept.len()];
        let mut row = vec![0.0; element.properties.len()];
        for _ in 0..element.count {
            for (value, property) in row.iter_mut().zip(&element.properties) {
                *value = self.items(property)?.first().copied().unwrap_or(f64::NAN);
            }
            self.end_element();
            mesh.nodes.push(DVec3::new(row[x], row[y], row[z]));
            for (values, n) in values.iter_mut().zip(&kept) {
                values.push(row[*n]);
            }
        }
        for (n, values) in kept.iter().zip(values) {
            let property = &element.properties[*n];
            mesh.fields.push(Field {
                scalar_type: property.scalar,
                ..Field::scalar(&property.name, Location::Node, values)
            });
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element, mesh: &mut RawMesh) -> ParseResult<()> {
        for _ in 0..element.count {
            for property in &element.properties {
                let items = self.items(property)?;
                if matches!(property.name.as_str(), "vertex_indices" | "vertex_index") {
                    if items.len() > MAX_CORNERS {
                        return Err(self.at.error(format_args!(
                            "face must have at most {MAX_CORNERS} corners, \
                                got {}",
                            items.len()
                        )));
                    }
                    mesh.cells.push(POLYGON, items.iter().map(|v| index(*v)));
                }
            }
            self.end_element();
        }
        Ok(())
    }

    /// Reads triangle strips in one list, separated by −1.
    fn strips(&mut self, element: &Element, mesh: &mut RawMesh) -> ParseResult<()> {
        const STRIP: u8 = 6;
        for _ in 0..element.count {
            for property in &element.properties {
                let items = self.items(property)?;
                if property.name == "vertex_indices" {
                    for strip in items.split(|v| *v < 0.0) {
                        mesh.cells.push(STRIP, strip.iter().map(|v| index(*v)));
                    }
                }
            }
            self.end_element();
        }
        Ok(())
    }
}

/// Converts a vertex index; an invalid one becomes one out of range.
fn index(value: f64) -> usize {
    match value >= 0.0 && value.fract() == 0.0 {
        true => value as usize,
        false => usize::MAX,
    }
}
