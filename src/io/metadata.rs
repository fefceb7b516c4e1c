//! Metadata in the comments of a format: `palpate:` and a JSON value per line. Other programs skip
//! comments; [`super::read`] parses them.

use super::cursor::ParseResult;
use super::groups::Groups;
use super::raw_mesh::RawMesh;
use super::scalar;
use crate::mesh::{AnatomicalFrame, Field, Location, ScalarType, TetMesh};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The prefix of each remark in a comment.
const COMMENT_PREFIX: &str = "palpate: ";

/// An item of metadata.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Remark {
    /// Unit of the coordinates in metres.
    LengthUnit(f64),
    /// Numbers of nodes and tets of the whole file, for formats without an end mark.
    Counts(usize, usize),
    /// A region of a group of cells: its value in the field `label`, and its name. `set` is the
    /// name of the group in formats that name groups instead of numbering them.
    Region {
        group: i64,
        label: i64,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        set: Option<String>,
    },
    /// The field stored in the next columns of attributes; its number type by VTK name.
    Field {
        name: String,
        components: usize,
        scalar: String,
    },
}

/// A region in a remark.
pub(super) struct Region {
    pub label: i64,
    pub name: Option<String>,
    pub set: Option<String>,
}

/// All remarks of a file.
#[derive(Default)]
pub(super) struct Metadata {
    unit: Option<f64>,
    frame: Option<AnatomicalFrame>,
    counts: Option<(usize, usize)>,
    /// By group.
    pub regions: BTreeMap<i64, Region>,
    fields: Vec<(String, usize, ScalarType)>,
}

impl Metadata {
    /// Parses the remarks in a text whose comments begin with `comment`.
    pub fn read(text: &[u8], comment: &str) -> Metadata {
        let mut remarks = Metadata::default();
        let start = format!("{comment}{COMMENT_PREFIX}");
        for line in text.split(|b| *b == b'\n') {
            let Some(told) = line.strip_prefix(start.as_bytes()) else {
                if remarks.frame.is_none() && line.starts_with(comment.trim_end().as_bytes()) {
                    remarks.frame = AnatomicalFrame::stated_in(line);
                }
                continue;
            };
            // Anything that cannot be parsed is an ordinary comment.
            match serde_json::from_slice(told) {
                Ok(Remark::LengthUnit(unit)) if unit.is_finite() && unit > 0.0 => {
                    remarks.unit = Some(unit);
                }
                Ok(Remark::Counts(nodes, tets)) => remarks.counts = Some((nodes, tets)),
                Ok(Remark::Region {
                    group,
                    label,
                    name,
                    set,
                }) => {
                    remarks.regions.insert(group, Region { label, name, set });
                }
                Ok(Remark::Field {
                    name,
                    components,
                    scalar,
                }) => {
                    let scalar = scalar::from_vtk_xml_name(&scalar).unwrap_or(ScalarType::F64);
                    remarks.fields.push((name, components, scalar));
                }
                _ => {}
            }
        }
        remarks
    }

    /// Sets the unit and the frame of reference of `mesh`.
    pub fn add_facts_to(&self, mesh: &mut RawMesh) {
        mesh.length_unit = self.unit.or(mesh.length_unit);
        mesh.frame = self.frame.or(mesh.frame);
    }

    /// Sets the unit and the frame of `mesh`, and, if there are regions, their names and the field `label`, from
    /// the group of each cell.
    pub fn add_to(&self, mesh: &mut RawMesh, group_of_cell: &[f64]) {
        self.add_facts_to(mesh);
        if self.regions.is_empty() {
            return;
        }
        mesh.region_names = self
            .regions
            .values()
            .filter_map(|r| Some((r.label, r.name.clone()?)))
            .collect();
        let label = |group: &f64| match self.regions.get(&(*group as i64)) {
            Some(region) => region.label as f64,
            None => *group,
        };
        let labels = group_of_cell.iter().map(label).collect();
        mesh.fields
            .retain(|f| f.name != "label" || f.location != Location::Cell);
        mesh.fields.push(integer_field("label", labels));
    }

    /// Converts columns of attributes to the fields of the remarks; `None` if these do not cover
    /// all columns.
    pub fn fields(&self, location: Location, columns: &[Vec<f64>]) -> Option<Vec<Field>> {
        let mut told = 0usize;
        for (_, components, _) in &self.fields {
            told = told.checked_add(*components).filter(|_| *components > 0)?;
        }
        if told != columns.len() {
            return None;
        }
        let mut columns = columns;
        let mut fields = Vec::with_capacity(self.fields.len());
        for (name, components, scalar_type) in &self.fields {
            let (own, rest) = columns.split_at(*components);
            columns = rest;
            let items = own.first().map_or(0, Vec::len);
            let tuples = (0..items).flat_map(|i| own.iter().map(move |column| column[i]));
            fields.push(Field {
                name: name.clone(),
                location,
                components: *components,
                values: tuples.collect(),
                scalar_type: *scalar_type,
            });
        }
        Some(fields)
    }

    /// Checks the numbers of nodes and cells against the remarks, if they state them.
    pub fn check_counts(&self, nodes: usize, cells: usize) -> ParseResult<()> {
        match self.counts {
            Some((n, c)) if (n, c) != (nodes, cells) => Err(format!(
                "file was written with {n} nodes and {c} elements, but has {nodes} and {cells} \
                (truncated or modified)"
            )),
            _ => Ok(()),
        }
    }
}

/// Creates an integer cell field, as Int32 if that represents all values.
pub(super) fn integer_field(name: &str, values: Vec<f64>) -> Field {
    Field {
        name: name.into(),
        location: Location::Cell,
        components: 1,
        scalar_type: match scalar::is_lossless(&values, ScalarType::I32) {
            true => ScalarType::I32,
            false => ScalarType::F64,
        },
        values,
    }
}

fn line(comment: &str, remark: &Remark) -> String {
    // These types have only values that JSON can represent.
    let json = serde_json::to_string(remark).unwrap_or_default();
    format!("{comment}{COMMENT_PREFIX}{json}\n")
}

/// Formats the lines with the unit and the regions of `mesh`; `sets` are the names of its groups,
/// if they have names.
pub(super) fn mesh_comments(
    comment: &str,
    mesh: &TetMesh,
    groups: &Groups,
    sets: &[String],
) -> String {
    let unit = mesh
        .length_unit
        .filter(|u| u.is_finite())
        .map(|unit| line(comment, &Remark::LengthUnit(unit)));
    let regions = groups.regions().enumerate().map(|(i, (group, region))| {
        let remark = Remark::Region {
            group: i64::from(group),
            label: region.label,
            name: region.name.clone(),
            set: sets.get(i).cloned(),
        };
        line(comment, &remark)
    });
    let frame = mesh.frame;
    let frame = frame.map(|f| format!("{comment}{}\n", f.statement()));
    frame.into_iter().chain(unit).chain(regions).collect()
}

/// Formats the line with the numbers of nodes and tets of a whole file.
pub(super) fn count_comment(comment: &str, mesh: &TetMesh) -> String {
    line(comment, &Remark::Counts(mesh.nodes.len(), mesh.tets.len()))
}

/// Formats the lines with the fields stored in the columns of attributes.
pub(super) fn field_comments(comment: &str, fields: &[&Field]) -> String {
    fields
        .iter()
        .map(|field| {
            let remark = Remark::Field {
                name: field.name.clone(),
                components: field.components,
                scalar: scalar::vtk_xml_name(field.scalar_type).to_owned(),
            };
            line(comment, &remark)
        })
        .collect()
}
