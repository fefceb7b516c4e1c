//! Writer for Medit `.mesh` files, text. Regions are the references of tets.
//! The middles of the edges of ten-node tets are in VTK's order, as in the files of Gmsh.

use super::atomic_write;
use super::format::dropped_fields_note;
use super::groups::Groups;
use super::metadata;
use super::ten_node::FileMesh;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Node fields of references, in the order of preference.
pub(super) const NODE_MARKERS: [&str; 2] = ["medit:ref", "tetgen:ref"];

/// Writes nodes, tets and references.
pub(super) fn write(path: &Path, file_mesh: &FileMesh) -> Result<Vec<String>> {
    let mesh = &*file_mesh.mesh;
    let groups = Groups::from_mesh(mesh, i32::MIN);
    let markers = node_markers(mesh);
    atomic_write(path, |file| {
        fill(file, file_mesh, &groups, markers).map_err(Error::io(path))
    })?;
    let others: Vec<&Field> = mesh
        .fields
        .iter()
        .filter(|f| {
            !groups.is_covered_by_groups(mesh, f) && !markers.is_some_and(|m| std::ptr::eq(m, *f))
        })
        .collect();
    let mut notes = Vec::new();
    if groups.renumbered {
        notes.push(
            "region labels are not valid Medit references; regions renumbered from 1".to_owned(),
        );
    }
    notes.extend(dropped_fields_note(
        &others,
        "Medit files cannot store fields",
    ));
    Ok(notes)
}

/// Returns the integer field of node markers.
pub(super) fn node_markers(mesh: &TetMesh) -> Option<&Field> {
    NODE_MARKERS
        .iter()
        .filter_map(|name| mesh.field(name, Location::Node))
        .find(|f| f.components == 1 && is_whole(&f.values))
}

/// Whether all values are 32-bit integers.
pub(super) fn is_whole(values: &[f64]) -> bool {
    values
        .iter()
        .all(|v| v.fract() == 0.0 && v.abs() <= f64::from(i32::MAX))
}

fn fill(
    file: &mut impl Write,
    file_mesh: &FileMesh,
    groups: &Groups,
    markers: Option<&Field>,
) -> std::io::Result<()> {
    let mesh = &*file_mesh.mesh;
    write!(
        file,
        "MeshVersionFormatted 2\nDimension 3\n{}Vertices\n{}\n",
        metadata::mesh_comments("# ", mesh, groups, &[]),
        mesh.nodes.len()
    )?;
    for (i, p) in mesh.nodes.iter().enumerate() {
        let marker = markers.map_or(0.0, |m| m.values[i]);
        writeln!(file, "{:?} {:?} {:?} {marker}", p.x, p.y, p.z)?;
    }
    let section = match file_mesh.order() {
        ElementOrder::Linear => "Tetrahedra",
        ElementOrder::Quadratic => "TetrahedraP2",
    };
    write!(file, "{section}\n{}\n", mesh.tets.len())?;
    for (t, nodes) in file_mesh.cells().enumerate() {
        for v in nodes {
            write!(file, "{} ", u64::from(*v) + 1)?;
        }
        let group = groups.tet_groups.get(t).copied().unwrap_or(0);
        writeln!(file, "{group}")?;
    }
    file.write_all(b"End\n")
}
