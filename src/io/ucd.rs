//! Reader for ASCII files of AVS UCD (`.inp`, `.ucd`, `.avs`), as LaGriT, deal.II and ParaView use
//! them.
//!
//! The material of each cell becomes the field `ucd:material`, unless it is 0 everywhere.

use super::cursor::{Cursor, ParseResult, integer, number};
use super::id_map::{Tags, repeated_numbers};
use super::metadata::integer_field;
use super::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, ScalarType};
use glam::DVec3;

/// Name, VTK number and nodes of a cell type; the place in the file of each node in VTK order.
const CELLS: [(&str, u8, &[usize]); 8] = [
    ("pt", 1, &[0]),
    ("line", 3, &[0, 1]),
    ("tri", 5, &[0, 1, 2]),
    ("quad", 9, &[0, 1, 2, 3]),
    ("tet", 10, &[0, 1, 2, 3]),
    // The apex is first, and the upper face precedes the lower one.
    ("pyr", 14, &[1, 2, 3, 4, 0]),
    ("prism", 13, &[3, 4, 5, 0, 1, 2]),
    ("hex", 12, &[4, 5, 6, 7, 0, 1, 2, 3]),
];

/// Whether `bytes` begin, after comments, with a line of five counts and one of a node.
pub(super) fn is_ucd(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(1 << 16)];
    let mut lines = start
        .split(|b| *b == b'\n')
        .map(<[u8]>::trim_ascii)
        .filter(|line| !line.is_empty() && !line.starts_with(b"#"));
    let counts = lines.next().map(words).unwrap_or_default();
    let node = lines.next().map(words).unwrap_or_default();
    let count = |word: &&[u8]| integer(word).is_some_and(|n| n >= 0);
    let numbers = |words: &[&[u8]]| words.iter().all(|w| number(w).is_some());
    counts.len() == 5
        && counts.iter().all(count)
        && (2..=4).contains(&node.len())
        && integer(node[0]).is_some()
        && numbers(&node)
}

fn words(line: &[u8]) -> Vec<&[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
        .collect()
}

/// Reads the content of a file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::new(bytes);
    // Comments are at the start only: units of data may contain the character.
    while at.peek().is_some_and(|token| token.starts_with(b"#")) {
        at.rest_of_line();
    }
    let nodes = at.count(format_args!("the number of nodes"), 4)?;
    let cells = at.count(format_args!("the number of cells"), 6)?;
    let of_nodes = at.count(format_args!("the number of values per node"), 1)?;
    let of_cells = at.count(format_args!("the number of values per cell"), 1)?;
    at.count(format_args!("the number of values of the model"), 1)?;
    let mut mesh = RawMesh::default();
    let node_tags = read_nodes(&mut at, nodes, &mut mesh)?;
    let cell_tags = read_cells(&mut at, cells, &node_tags, &mut mesh)?;
    for (values, location, tags, items) in [
        (of_nodes, Location::Node, &node_tags, nodes),
        (of_cells, Location::Cell, &cell_tags, cells),
    ] {
        if values > 0 {
            read_data(&mut at, values, location, tags, items, &mut mesh)?;
        }
    }
    Ok(mesh)
}

fn read_nodes(at: &mut Cursor, count: usize, mesh: &mut RawMesh) -> ParseResult<Tags> {
    let mut tags = Tags::default();
    for i in 1..=count {
        let tag = at.integer(format_args!("the number of node {i} of {count}"))?;
        let mut position = [0.0; 3];
        for x in &mut position {
            *x = at.number(format_args!("a coordinate of node {tag}"))?;
        }
        if !tags.push(tag as u64) {
            return Err(at.error(format_args!("node {tag} is defined twice")));
        }
        mesh.nodes.push(DVec3::from_array(position));
    }
    Ok(tags)
}

fn read_cells(
    at: &mut Cursor,
    count: usize,
    nodes: &Tags,
    mesh: &mut RawMesh,
) -> ParseResult<Tags> {
    let mut tags = Tags::default();
    let mut materials = Vec::new();
    let mut repeated = 0;
    for i in 1..=count {
        let tag = at.integer(format_args!("the number of cell {i} of {count}"))?;
        materials.push(at.integer(format_args!("the material of cell {tag}"))? as f64);
        let name = at.word(format_args!("the type of cell {tag}"))?;
        let shape = CELLS.iter().find(|c| name.eq_ignore_ascii_case(c.0));
        let Some((_, kind, order)) = shape else {
            let known: Vec<&str> = CELLS.iter().map(|c| c.0).collect();
            let shown: String = name.chars().take(40).collect();
            return Err(at.error(format_args!(
                "cell {tag} has the type {shown:?}; expected one of {}",
                known.join(", ")
            )));
        };
        let mut corners = [0; 8];
        for corner in &mut corners[..order.len()] {
            let node = at.integer(format_args!("a node of cell {tag}"))?;
            *corner = nodes.get(node as u64).ok_or_else(|| {
                at.error(format_args!("cell {tag} refers to undefined node {node}"))
            })?;
        }
        mesh.cells.push(*kind, order.iter().map(|k| corners[*k]));
        if !tags.push(tag as u64) {
            tags.push_unnamed();
            repeated += 1;
        }
    }
    if repeated > 0 {
        mesh.warnings.push(repeated_numbers(repeated));
    }
    if materials.iter().any(|m| *m != 0.0) {
        mesh.fields.push(integer_field("ucd:material", materials));
    }
    Ok(tags)
}

/// Reads the values of nodes or cells: the number of fields and their components, a line "name,
/// unit" per field, and a line per item. A field with an invalid value is left out with a warning.
fn read_data(
    at: &mut Cursor,
    announced: usize,
    location: Location,
    tags: &Tags,
    items: usize,
    mesh: &mut RawMesh,
) -> ParseResult<()> {
    let count = at.count(format_args!("the number of fields of {location}"), 1)?;
    let mut widths = Vec::new();
    let mut columns = 0usize;
    for i in 1..=count {
        let width = at.count(format_args!("the components of field {i} of {location}"), 0)?;
        columns = columns.saturating_add(width);
        widths.push(width);
    }
    if columns != announced {
        return Err(at.error(format_args!(
            "the fields of {location} have {columns} components, but the first line of the file \
            states {announced}"
        )));
    }
    at.validate_count(
        i64::try_from(columns.saturating_mul(items)).unwrap_or(i64::MAX),
        format_args!("the number of values of {location}"),
        1,
    )?;
    at.rest_of_line();
    let mut fields: Vec<Column> = Vec::new();
    for width in widths {
        let line = String::from_utf8_lossy(at.rest_of_line()).into_owned();
        let name = line.split(',').next().unwrap_or_default().trim();
        fields.push(Column::new(name, width, items));
    }
    let mut seen = vec![false; items];
    for i in 1..=items {
        let Some((start, line)) = at.line() else {
            return Err(at.error(format_args!(
                "unexpected end of file, expected the values of {i} of {items} {location}"
            )));
        };
        let words = words(line);
        let tag = words.first().and_then(|word| integer(word));
        let item = tag.and_then(|tag| tags.get(tag as u64)).ok_or_else(|| {
            let shown = String::from_utf8_lossy(words.first().copied().unwrap_or_default());
            at.error_at(
                start,
                format_args!(
                    "values belong to {shown:?}, expected the number of one of the {location}"
                ),
            )
        })?;
        if std::mem::replace(&mut seen[item], true) {
            let tag = tag.unwrap_or_default();
            return Err(at.error_at(start, format_args!("{tag} has values twice")));
        }
        let mut first = 1;
        for field in &mut fields {
            field.set(item, words.get(first..), |what| at.error_at(start, what));
            first += field.width;
        }
    }
    for field in fields {
        field.add_to(mesh, location);
    }
    Ok(())
}

/// A field being read.
struct Column {
    name: String,
    width: usize,
    values: Vec<f64>,
    defect: Option<String>,
}

impl Column {
    fn new(name: &str, width: usize, items: usize) -> Column {
        Column {
            name: name.to_owned(),
            width,
            values: vec![f64::NAN; width * items],
            defect: None,
        }
    }

    /// Stores the tuple of `item`, the first of `words`.
    fn set(&mut self, item: usize, words: Option<&[&[u8]]>, error: impl Fn(String) -> String) {
        for k in 0..self.width {
            let word = words.and_then(|w| w.get(k)).copied().unwrap_or_default();
            match number(word) {
                Some(value) => self.values[item * self.width + k] = value,
                None => {
                    let shown = String::from_utf8_lossy(&word[..word.len().min(40)]);
                    self.defect.get_or_insert_with(|| {
                        error(format!("expected a number, found {shown:?}"))
                    });
                }
            }
        }
    }

    fn add_to(self, mesh: &mut RawMesh, location: Location) {
        if let Some(defect) = self.defect {
            mesh.warnings
                .push(format!("field \"{}\" skipped: {defect}", self.name));
            return;
        }
        mesh.fields.push(Field {
            name: self.name,
            location,
            components: self.width,
            values: self.values,
            scalar_type: ScalarType::F64,
        });
    }
}
