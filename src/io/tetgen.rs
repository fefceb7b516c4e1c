//! Reader for TetGen `.node` and `.ele` files, either of which may be given.
//!
//! Fields have the names used by meshio: `tetgen:attr1` ... for attributes and `tetgen:ref` for
//! boundary markers of nodes; `tetgen:ref` for the region of tets (`tetgen:ref2` ... for further
//! attributes). Markers and regions that are constant 0 carry no information and are dropped.

use super::cursor::{Cursor, ParseResult, integer, number};
use super::id_map::{Tags, repeated_numbers};
use super::metadata::Metadata;
use super::raw_mesh::RawMesh;
use super::ten_node::sort_by_position;
use crate::mesh::{Field, Location, ScalarType};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt::Arguments;
use std::path::{Path, PathBuf};

/// Returns the pair of files, `.node` and `.ele`, that `path` belongs to; both are compressed with
/// gzip (`.gz`), or none.
pub(super) fn pair(path: &Path) -> (PathBuf, PathBuf) {
    if super::extension(path) == "gz" {
        let end = path.extension().unwrap_or_default();
        let (node, ele) = pair(&path.with_extension(""));
        return (
            node.with_added_extension(end),
            ele.with_added_extension(end),
        );
    }
    let file = |extension: &str| {
        let upper = path
            .extension()
            .is_some_and(|e| e.to_string_lossy().chars().all(char::is_uppercase));
        path.with_extension(if upper {
            extension.to_uppercase()
        } else {
            extension.into()
        })
    };
    (file("node"), file("ele"))
}

/// Reads the pair of files that `path` (`x.node` or `x.ele`) belongs to.
pub(super) fn read(path: &Path) -> Result<RawMesh> {
    let mut mesh = RawMesh::default();
    let (node_path, ele_path) = pair(path);
    let nodes = super::content(&node_path)?;
    let tags = read_nodes(&nodes, &mut mesh).map_err(|e| Error::format(&node_path, e))?;
    let elements = super::content(&ele_path)?;
    read_elements(&elements, &tags, &mut mesh).map_err(|e| Error::format(&ele_path, e))?;
    Ok(mesh)
}

/// A line of numbers, and its position.
struct Row<'a> {
    start: usize,
    tokens: Vec<&'a [u8]>,
}

impl<'a> Row<'a> {
    /// Reads the next line, which should have at least `width` columns.
    fn read(at: &mut Cursor<'a>, width: usize, what: Arguments) -> ParseResult<Row<'a>> {
        let Some((start, line)) = at.line() else {
            return Err(at.error(format_args!("unexpected end of file, expected {what}")));
        };
        let tokens: Vec<_> = line
            .split(u8::is_ascii_whitespace)
            .filter(|t| !t.is_empty())
            .collect();
        let row = Row { start, tokens };
        if row.tokens.len() < width {
            return Err(at.error_at(
                start,
                format_args!(
                    "{what} has {} columns, expected {width}: {:?}",
                    row.tokens.len(),
                    String::from_utf8_lossy(&line[..line.len().min(60)])
                ),
            ));
        }
        Ok(row)
    }

    /// Parses the value of column `i` with `parse`.
    fn value<T>(
        &self,
        at: &Cursor,
        i: usize,
        what: Arguments,
        parse: impl Fn(&[u8]) -> Option<T>,
    ) -> ParseResult<T> {
        let token = self.tokens.get(i).copied().unwrap_or_default();
        parse(token).ok_or_else(|| {
            let shown = String::from_utf8_lossy(&token[..token.len().min(40)]);
            at.error_at(self.start, format_args!("expected {what}, found {shown:?}"))
        })
    }
}

/// Columns of attributes. One with an invalid value is left out with a warning.
struct Columns {
    values: Vec<Vec<f64>>,
    /// The first defect of each column that has any.
    defects: BTreeMap<usize, String>,
}

impl Columns {
    fn new(count: usize) -> Columns {
        Columns {
            values: vec![Vec::new(); count],
            defects: BTreeMap::new(),
        }
    }

    /// Reads the attributes of a row, of which the first is in column `first`.
    fn read(&mut self, at: &Cursor, row: &Row, first: usize, what: Arguments) {
        for (k, values) in self.values.iter_mut().enumerate() {
            if self.defects.contains_key(&k) {
                continue;
            }
            match row.value(at, first + k, what, number) {
                Ok(value) => values.push(value),
                Err(defect) => {
                    self.defects.insert(k, defect);
                }
            }
        }
    }

    /// Returns the columns; those with defects are empty.
    fn finish(mut self, location: Location, warnings: &mut Vec<String>) -> Vec<Vec<f64>> {
        for (k, defect) in self.defects {
            self.values[k].clear();
            let number = k + 1;
            warnings.push(format!(
                "attribute {number} of {location} skipped: {defect}"
            ));
        }
        self.values
    }
}

/// Reads the header: the number of items, and the numbers after it.
fn header(at: &mut Cursor, what: &str, least_bytes: usize) -> ParseResult<(usize, Vec<i64>)> {
    let row = Row::read(at, 1, format_args!("the header ({what})"))?;
    let numbers = (0..row.tokens.len())
        .map(|i| {
            row.value(
                at,
                i,
                format_args!("integers in the header ({what})"),
                integer,
            )
        })
        .collect::<ParseResult<Vec<i64>>>()?;
    let count = at.validate_count(
        numbers[0],
        format_args!("the first number of the header ({what})"),
        least_bytes,
    )?;
    Ok((count, numbers))
}

/// Returns a number of columns in the header.
fn columns(header: &[i64], i: usize, most: i64, what: &str) -> ParseResult<usize> {
    let value = header.get(i).copied().unwrap_or(0);
    (0..=most)
        .contains(&value)
        .then_some(value as usize)
        .ok_or_else(|| format!("header states {value} {what}, expected 0 to {most}"))
}

fn no_more(at: &mut Cursor, count: usize, what: &str) -> ParseResult<()> {
    match at.line() {
        None => Ok(()),
        Some((start, _)) => Err(at.error_at(
            start,
            format_args!("more lines than the {count} {what} stated in the header"),
        )),
    }
}

/// Reads the nodes; returns the map from their numbers in the file to indices.
pub(super) fn read_nodes(bytes: &[u8], mesh: &mut RawMesh) -> ParseResult<Tags> {
    let mut at = Cursor::with_comments(bytes);
    let (count, header) = header(&mut at, "nodes, dimension, attributes, boundary markers", 8)?;
    if let Some(other) = header.get(1).filter(|d| **d != 3) {
        return Err(format!("header states dimension {other}, expected 3"));
    }
    if count == 0 {
        return Err("file has no nodes".into());
    }
    let attributes = columns(&header, 2, 1 << 12, "attributes")?;
    let markers = columns(&header, 3, 1, "boundary markers")?;
    let mut tags = Tags::default();
    let mut extra = Columns::new(attributes + markers);
    for i in 0..count {
        let what = format_args!("node {i} of {count} (counted from 0)");
        let row = Row::read(&mut at, 4 + attributes + markers, what)?;
        let index = row.value(&at, 0, format_args!("the index of {what}"), integer)?;
        if !tags.push(index as u64) {
            return Err(at.error_at(row.start, format_args!("node {index} is defined twice")));
        }
        let coordinate =
            |k| row.value(&at, k, format_args!("a coordinate of node {index}"), number);
        mesh.nodes
            .push(DVec3::new(coordinate(1)?, coordinate(2)?, coordinate(3)?));
        extra.read(&at, &row, 4, format_args!("an attribute of node {index}"));
    }
    no_more(&mut at, count, "nodes")?;
    let whole = extra.defects.is_empty();
    let mut extra = extra.finish(Location::Node, &mut mesh.warnings);
    let markers = extra.split_off(attributes);
    let remarks = Metadata::read(bytes, "# ");
    if whole && let Some(fields) = remarks.fields(Location::Node, &extra) {
        mesh.fields.extend(fields);
        extra.clear();
    }
    for (i, values) in extra.into_iter().enumerate() {
        if values.is_empty() {
            continue;
        }
        let name = format!("tetgen:attr{}", i + 1);
        mesh.fields
            .push(Field::scalar(name, Location::Node, values));
    }
    keep_labels(mesh, Location::Node, markers);
    Ok(tags)
}

pub(super) fn read_elements(bytes: &[u8], tags: &Tags, mesh: &mut RawMesh) -> ParseResult<()> {
    let mut at = Cursor::with_comments(bytes);
    let (count, header) = header(&mut at, "tetrahedra, nodes of each, attributes", 10)?;
    let (kind, corners) = match header.get(1).copied().unwrap_or(4) {
        4 => (10, 4),
        10 => (24, 10),
        other => {
            return Err(format!(
                "header states {other} nodes per tetrahedron, expected 4 or 10"
            ));
        }
    };
    let attributes = columns(&header, 2, 1 << 12, "attributes")?;
    let node = |token: &[u8]| tags.get(integer(token)? as u64);
    let mut extra = Columns::new(attributes);
    let (mut numbers, mut repeated) = (Tags::default(), 0);
    for i in 0..count {
        let what = format_args!("tetrahedron {i} of {count} (counted from 0)");
        let row = Row::read(&mut at, 1 + corners + attributes, what)?;
        let tag = row.value(&at, 0, format_args!("the number of {what}"), integer)?;
        if !numbers.push(tag as u64) {
            numbers.push_unnamed();
            repeated += 1;
        }
        let mut tet = [0; 10];
        for (k, corner) in tet[..corners].iter_mut().enumerate() {
            let wanted = format_args!("a node of {what} that is in the .node file");
            *corner = row.value(&at, 1 + k, wanted, node)?;
        }
        let wanted = format_args!("an attribute of {what}");
        extra.read(&at, &row, 1 + corners, wanted);
        if corners == 10 {
            sort_by_position(&mut tet, |v| mesh.nodes.get(v).copied().unwrap_or_default());
        }
        mesh.cells.push(kind, tet[..corners].iter().copied());
    }
    no_more(&mut at, count, "tetrahedra")?;
    if repeated > 0 {
        mesh.warnings.push(repeated_numbers(repeated));
    }
    let remarks = Metadata::read(bytes, "# ");
    let whole = extra.defects.is_empty();
    let mut extra = extra.finish(Location::Cell, &mut mesh.warnings);
    match extra.first().filter(|groups| !groups.is_empty()) {
        Some(groups) => remarks.add_to(mesh, groups),
        None => remarks.add_facts_to(mesh),
    }
    let regions = usize::from(!remarks.regions.is_empty()).min(extra.len());
    if whole && let Some(fields) = remarks.fields(Location::Cell, &extra[regions..]) {
        mesh.fields.extend(fields);
        extra.truncate(regions);
    }
    keep_labels(mesh, Location::Cell, extra);
    Ok(())
}

/// Adds columns of labels as `tetgen:ref`, `tetgen:ref2` ..., except those that are constant 0.
fn keep_labels(mesh: &mut RawMesh, location: Location, columns: Vec<Vec<f64>>) {
    for (i, values) in columns.into_iter().enumerate() {
        if values.iter().all(|v| *v == 0.0) {
            continue;
        }
        let suffix = if i == 0 {
            String::new()
        } else {
            (i + 1).to_string()
        };
        mesh.fields.push(Field {
            name: format!("tetgen:ref{suffix}"),
            location,
            components: 1,
            scalar_type: if super::scalar::is_lossless(&values, ScalarType::I32) {
                ScalarType::I32
            } else {
                ScalarType::F64
            },
            values,
        });
    }
}
