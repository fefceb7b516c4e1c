//! The names of a mesh's regions and its unit of length in `.vtu` files: three arrays of
//! `<FieldData>`, as ASCII, which VTK and ParaView keep as data of the whole mesh.

use super::cells::RawMesh;
use crate::mesh::TetMesh;
use std::fmt::Write;

/// Metres in one unit of the coordinates.
const UNIT: &str = "length_unit";
/// The values of the cell field `label` that have names, and the names.
const LABELS: &str = "region_labels";
const NAMES: &str = "region_names";

/// The tags that tell what is known of `mesh`; nothing where nothing is.
pub(super) fn tags(mesh: &TetMesh) -> String {
    let mut tags = String::new();
    // Writing to a string cannot fail.
    if let Some(unit) = mesh.length_unit {
        let _ = writeln!(
            tags,
            "<DataArray type=\"Float64\" Name=\"{UNIT}\" NumberOfTuples=\"1\" format=\"ascii\">{unit}</DataArray>"
        );
    }
    if !mesh.region_names.is_empty() {
        let count = mesh.region_names.len();
        let labels: Vec<String> = mesh.region_names.keys().map(i64::to_string).collect();
        let codes: Vec<String> = mesh
            .region_names
            .values()
            .flat_map(|name| name.bytes().filter(|b| *b != 0).chain([0]))
            .map(|code| code.to_string())
            .collect();
        let _ = write!(
            tags,
            "<DataArray type=\"Int64\" Name=\"{LABELS}\" NumberOfTuples=\"{count}\" format=\"ascii\">{}</DataArray>\n<Array type=\"String\" Name=\"{NAMES}\" NumberOfTuples=\"{count}\" format=\"ascii\">{}</Array>\n",
            labels.join(" "),
            codes.join(" ")
        );
    }
    match tags.is_empty() {
        true => tags,
        false => format!("<FieldData>\n{tags}</FieldData>\n"),
    }
}

/// What a file tells of its mesh as a whole. What is not understood is passed over: any program
/// may put arrays there.
#[derive(Default)]
pub(super) struct Global {
    current: String,
    unit: Option<f64>,
    labels: Vec<i64>,
    names: Vec<String>,
}

impl Global {
    /// An array begins, called `name` (empty for one that is not ASCII).
    pub fn array(&mut self, name: String) {
        self.current = name;
    }

    /// The text of the array that began last.
    pub fn text(&mut self, text: &[u8]) {
        let text = String::from_utf8_lossy(text);
        let words = text.split_whitespace();
        match self.current.as_str() {
            UNIT => {
                let unit = words.map_while(|w| w.parse().ok()).next();
                self.unit = unit.filter(|u: &f64| u.is_finite() && *u > 0.0);
            }
            LABELS => self.labels = words.map_while(|w| w.parse().ok()).collect(),
            NAMES => {
                let codes: Vec<u8> = words.map_while(|w| w.parse().ok()).collect();
                let ended = codes.strip_suffix(&[0]).unwrap_or(&codes);
                self.names = ended
                    .split(|code| *code == 0)
                    .map(|name| String::from_utf8_lossy(name).into_owned())
                    .collect();
            }
            _ => {}
        }
    }

    /// Hands what was told to `mesh`.
    pub fn add_to(&self, mesh: &mut RawMesh) {
        mesh.length_unit = self.unit;
        if self.labels.len() == self.names.len() {
            let named = self.labels.iter().copied().zip(self.names.iter().cloned());
            mesh.region_names = named.collect();
        }
    }
}
