//! Writer for Abaqus input files: nodes, C3D4 or C3D10 elements, and one element set per region. Materials,
//! sections and steps are left to the user.

use super::atomic_write;
use super::format::dropped_fields_note;
use super::groups::Groups;
use super::metadata;
use super::ten_node::FileMesh;
use crate::mesh::{ElementOrder, Field};
use crate::{Error, Result};
use std::collections::{BTreeMap, HashSet};
use std::io::Write;
use std::path::Path;

/// Maximum length of a number in characters: the limit of CalculiX.
const DIGITS: usize = 20;
/// Maximum length of the name of a set in characters.
const MAX_NAME_LENGTH: usize = 80;
/// Maximum number of entries on a line of a set.
const COLUMNS: usize = 16;

/// Writes nodes, tets and regions.
pub(super) fn write(path: &Path, file_mesh: &FileMesh) -> Result<Vec<String>> {
    let mesh = &*file_mesh.mesh;
    let groups = Groups::from_mesh(mesh, 1);
    let sets = set_names(&groups);
    atomic_write(path, |file| {
        fill(file, file_mesh, &groups, &sets).map_err(Error::io(path))
    })?;
    let others: Vec<&Field> = mesh
        .fields
        .iter()
        .filter(|f| !groups.is_covered_by_groups(mesh, f))
        .collect();
    let why = "Abaqus input files cannot store fields";
    Ok(dropped_fields_note(&others, why).into_iter().collect())
}

/// Returns unique names for the sets of the groups, in characters that every reader accepts.
fn set_names(groups: &Groups) -> Vec<String> {
    let mut taken = HashSet::new();
    groups
        .all()
        .map(|(group, region)| {
            let plain = |c: char| match c.is_ascii_alphanumeric() {
                true => c,
                false => '_',
            };
            let name = region.name.as_deref().unwrap_or_default();
            let mut name: String = name.chars().map(plain).take(MAX_NAME_LENGTH / 2).collect();
            if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
                name = format!("REGION_{name}");
            }
            if name == "REGION_" {
                name = format!("REGION_{group}");
            }
            while !taken.insert(name.to_ascii_uppercase()) {
                name = format!("{name}_{group}");
            }
            name
        })
        .collect()
}

/// Formats `value` with the most digits that fit into [`DIGITS`] characters.
fn short(value: f64) -> String {
    let whole = format!("{value:?}");
    if whole.len() <= DIGITS {
        return whole;
    }
    (8..=16)
        .rev()
        .map(|digits| format!("{value:.digits$e}"))
        .find(|text| text.len() <= DIGITS)
        .unwrap_or(whole)
}

fn fill(
    file: &mut impl Write,
    file_mesh: &FileMesh,
    groups: &Groups,
    sets: &[String],
) -> std::io::Result<()> {
    let mesh = &*file_mesh.mesh;
    write!(
        file,
        "*HEADING\nWritten by Palpate {}\n{}{}*NODE\n",
        env!("CARGO_PKG_VERSION"),
        metadata::count_comment("** ", mesh),
        metadata::mesh_comments("** ", mesh, groups, sets)
    )?;
    for (i, p) in mesh.nodes.iter().enumerate() {
        let [x, y, z] = p.to_array().map(short);
        writeln!(file, "{}, {x}, {y}, {z}", i + 1)?;
    }
    let element = match file_mesh.order() {
        ElementOrder::Linear => "C3D4",
        ElementOrder::Quadratic => "C3D10",
    };
    writeln!(file, "*ELEMENT, TYPE={element}")?;
    for (t, nodes) in file_mesh.cells().enumerate() {
        write!(file, "{}", t + 1)?;
        for v in nodes {
            write!(file, ", {}", u64::from(*v) + 1)?;
        }
        writeln!(file)?;
    }
    let mut tets: BTreeMap<i32, Vec<String>> = BTreeMap::new();
    for (t, group) in groups.tet_groups.iter().enumerate() {
        tets.entry(*group).or_default().push((t + 1).to_string());
    }
    for ((group, _), set) in groups.all().zip(sets) {
        writeln!(file, "*ELSET, ELSET={set}")?;
        for line in tets.remove(&group).unwrap_or_default().chunks(COLUMNS) {
            writeln!(file, "{}", line.join(", "))?;
        }
    }
    Ok(())
}
