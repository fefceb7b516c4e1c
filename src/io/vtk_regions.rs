//! Names of regions and unit of length in VTK files: arrays of the whole mesh (`FieldData`), which
//! VTK, ParaView and meshio read as numbers.
//!
//! `length_unit` is the unit of the coordinates in metres, and an array `region:NAME` holds the
//! values of the cell field `label` in the region NAME.

use super::raw_mesh::RawMesh;
use crate::mesh::TetMesh;
use std::collections::BTreeMap;

/// Array of the unit of the coordinates in metres.
const UNIT: &str = "length_unit";
/// Prefix of the name of a region.
const REGION: &str = "region:";
/// Legacy form of the names: values of `label`, and the bytes of their names, each terminated by a
/// 0.
const LABELS: &str = "region_labels";
const NAMES: &str = "region_names";

/// Values of an array of the whole mesh.
pub(super) enum Values {
    Real(f64),
    Labels(Vec<i64>),
}

/// Returns the arrays of the unit and the regions of `mesh`, by name; empty if nothing is known.
pub(super) fn arrays(mesh: &TetMesh) -> Vec<(String, Values)> {
    let unit = mesh.length_unit.map(|u| (UNIT.to_owned(), Values::Real(u)));
    let mut named: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
    for (label, name) in &mesh.region_names {
        named.entry(name).or_default().push(*label);
    }
    let regions = named
        .into_iter()
        .map(|(name, labels)| (format!("{REGION}{name}"), Values::Labels(labels)));
    unit.into_iter().chain(regions).collect()
}

/// Whether an array of the whole mesh with this name describes its regions or unit.
pub(super) fn is_known(name: &str) -> bool {
    [UNIT, LABELS, NAMES].contains(&name) || name.starts_with(REGION)
}

/// The data about the whole mesh in a file. Unknown arrays are skipped: any program may add them.
#[derive(Default)]
pub(super) struct Global {
    unit: Option<f64>,
    regions: BTreeMap<i64, String>,
    labels: Vec<i64>,
    names: Vec<String>,
}

impl Global {
    /// Reads an array of numbers, or of the bytes of strings terminated by 0.
    pub fn array(&mut self, name: &str, values: &[f64]) {
        let whole = |v: &&f64| v.fract() == 0.0 && v.abs() < 9e15;
        let labels = values.iter().filter(whole).map(|v| *v as i64);
        match name {
            UNIT => {
                let unit = values.first().copied();
                self.unit = unit.filter(|u| u.is_finite() && *u > 0.0);
            }
            LABELS => self.labels = labels.collect(),
            NAMES => {
                let codes: Vec<u8> = values.iter().map(|v| *v as u8).collect();
                let ended = codes.strip_suffix(&[0]).unwrap_or(&codes);
                self.names = ended
                    .split(|code| *code == 0)
                    .map(|name| String::from_utf8_lossy(name).into_owned())
                    .collect();
            }
            _ => {
                if let Some(region) = name.strip_prefix(REGION) {
                    let named = labels.map(|label| (label, region.to_owned()));
                    self.regions.extend(named);
                }
            }
        }
    }

    /// Applies the data to `mesh`.
    pub fn add_to(mut self, mesh: &mut RawMesh) {
        mesh.length_unit = self.unit;
        if self.labels.len() == self.names.len() {
            self.regions.extend(self.labels.into_iter().zip(self.names));
        }
        mesh.region_names = self.regions;
    }
}
