//! Writer for TetGen `.node` and `.ele` files. Regions are the first attribute of tets, node fields
//! are attributes of nodes; comments name the columns.

use super::atomic_write;
use super::format::dropped_fields_note;
use super::groups::Groups;
use super::medit_write::{is_whole, node_markers};
use super::metadata;
use super::metadata::integer_field;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Writes the pair of files that `path` (`x.node` or `x.ele`) belongs to.
pub(super) fn write(path: &Path, mesh: &TetMesh) -> Result<Vec<String>> {
    let groups = Groups::from_mesh(mesh, i32::MIN);
    let markers = node_markers(mesh);
    let (node_fields, cell_fields): (Vec<&Field>, Vec<&Field>) = mesh
        .fields
        .iter()
        .filter(|f| {
            !groups.is_covered_by_groups(mesh, f) && !markers.is_some_and(|m| std::ptr::eq(m, *f))
        })
        .partition(|f| f.location == Location::Node);
    // Most readers of .ele files accept integer attributes only.
    let (cell_fields, others): (Vec<&Field>, Vec<&Field>) =
        cell_fields.into_iter().partition(|f| is_whole(&f.values));
    let (node_path, ele_path) = super::tetgen::pair(path);
    atomic_write(&node_path, |file| {
        nodes(file, mesh, &node_fields, markers).map_err(Error::io(&node_path))?;
        // Renamed immediately before the node file: both files are new, or neither.
        atomic_write(&ele_path, |file| {
            tets(file, mesh, &groups, &cell_fields).map_err(Error::io(&ele_path))
        })
    })?;
    let mut notes = Vec::new();
    if groups.renumbered {
        notes.push(
            "region labels are not 32-bit integers; region attributes renumbered from 1".to_owned(),
        );
    }
    if mesh.order == ElementOrder::Quadratic {
        let note = "each ten-node tet written as eight four-node ones to TetGen files";
        notes.push(note.to_owned());
    }
    let why = "attributes of tets must be integers";
    notes.extend(dropped_fields_note(&others, why));
    Ok(notes)
}

fn header(file: &mut impl Write, remarks: &str) -> std::io::Result<()> {
    let version = env!("CARGO_PKG_VERSION");
    write!(file, "# Written by Palpate {version}\n{remarks}")
}

fn columns(fields: &[&Field]) -> usize {
    fields.iter().map(|f| f.components).sum()
}

fn tuple<'a>(fields: &'a [&Field], item: usize) -> impl Iterator<Item = f64> + 'a {
    fields.iter().flat_map(move |f| {
        let start = item * f.components;
        f.values[start..start + f.components].iter().copied()
    })
}

fn nodes(
    file: &mut impl Write,
    mesh: &TetMesh,
    fields: &[&Field],
    markers: Option<&Field>,
) -> std::io::Result<()> {
    header(file, &metadata::field_comments("# ", fields))?;
    let marked = u8::from(markers.is_some());
    writeln!(file, "{} 3 {} {marked}", mesh.nodes.len(), columns(fields))?;
    for (i, p) in mesh.nodes.iter().enumerate() {
        write!(file, "{} {:?} {:?} {:?}", i + 1, p.x, p.y, p.z)?;
        for value in tuple(fields, i) {
            write!(file, " {value:?}")?;
        }
        if let Some(markers) = markers {
            write!(file, " {}", markers.values[i])?;
        }
        writeln!(file)?;
    }
    Ok(())
}

fn tets(
    file: &mut impl Write,
    mesh: &TetMesh,
    groups: &Groups,
    fields: &[&Field],
) -> std::io::Result<()> {
    let mut told = metadata::mesh_comments("# ", mesh, groups, &[]);
    if !fields.is_empty() {
        // Groups that are not regions are an ordinary column.
        let column = integer_field("tetgen:ref", Vec::new());
        let plain = !groups.tet_groups.is_empty() && groups.regions().next().is_none();
        let columns: Vec<&Field> = plain.then_some(&column).into_iter().collect();
        told += &metadata::field_comments("# ", &[columns, fields.to_vec()].concat());
    }
    header(file, &told)?;
    let grouped = usize::from(!groups.tet_groups.is_empty());
    writeln!(file, "{} 4 {}", mesh.tets.len(), grouped + columns(fields))?;
    for (t, tet) in mesh.tets.iter().enumerate() {
        let [a, b, c, d] = tet.map(|v| u64::from(v) + 1);
        write!(file, "{} {a} {b} {c} {d}", t + 1)?;
        if let Some(group) = groups.tet_groups.get(t) {
            write!(file, " {group}")?;
        }
        for value in tuple(fields, t) {
            write!(file, " {value}")?;
        }
        writeln!(file)?;
    }
    Ok(())
}
