//! Writer for the VTK legacy format, version 3 (supported by all readers), binary or text.

use super::ten_node::FileMesh;
use super::vtk_legacy_names::encoded;
use super::vtk_regions::{self, Values};
use super::{atomic_write, scalar};
use crate::mesh::{Field, Location, ScalarType};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Writes `mesh` with all its fields.
pub(super) fn write(path: &Path, mesh: &FileMesh, text: bool) -> Result<Vec<String>> {
    atomic_write(path, |file| fill(file, mesh, text).map_err(Error::io(path)))?;
    Ok(Vec::new())
}

fn fill(file: &mut impl Write, file_mesh: &FileMesh, text: bool) -> std::io::Result<()> {
    let mesh = &*file_mesh.mesh;
    // 3D Slicer reads it in the title.
    let frame = mesh.frame;
    let frame = frame.map_or(String::new(), |f| format!(". {}", f.statement()));
    let mode = if text { "ASCII" } else { "BINARY" };
    write!(
        file,
        "# vtk DataFile Version 3.0\nWritten by Palpate {}{frame}\n{mode}\nDATASET UNSTRUCTURED_GRID\n",
        env!("CARGO_PKG_VERSION")
    )?;
    let global = vtk_regions::arrays(mesh);
    if !global.is_empty() {
        writeln!(file, "FIELD FieldData {}", global.len())?;
    }
    for (name, values) in global {
        let values = match values {
            Values::Real(value) => (vec![value], ScalarType::F64),
            Values::Labels(labels) => (labels.iter().map(|l| *l as f64).collect(), ScalarType::I64),
        };
        array(file, text, &name, 1, &values.0, values.1)?;
    }
    let nodes: Vec<f64> = mesh.nodes.iter().flat_map(|p| p.to_array()).collect();
    writeln!(file, "POINTS {} double", mesh.nodes.len())?;
    numbers(file, text, &nodes, ScalarType::F64, 3)?;
    let count = mesh.tets.len();
    let width = file_mesh.width();
    let cells: Vec<f64> = file_mesh
        .cells()
        .flat_map(|nodes| std::iter::once(width as f64).chain(nodes.iter().map(|v| f64::from(*v))))
        .collect();
    writeln!(file, "CELLS {count} {}", (width + 1) * count)?;
    numbers(file, text, &cells, ScalarType::I32, width + 1)?;
    writeln!(file, "CELL_TYPES {count}")?;
    let kinds = vec![f64::from(file_mesh.kind()); count];
    numbers(file, text, &kinds, ScalarType::I32, 1)?;
    for (section, location, items) in [
        ("POINT_DATA", Location::Node, mesh.nodes.len()),
        ("CELL_DATA", Location::Cell, count),
    ] {
        let fields: Vec<&Field> = mesh
            .fields
            .iter()
            .filter(|f| f.location == location)
            .collect();
        if fields.is_empty() {
            continue;
        }
        write!(
            file,
            "{section} {items}\nFIELD FieldData {}\n",
            fields.len()
        )?;
        for field in fields {
            array(
                file,
                text,
                &field.name,
                field.components,
                &field.values,
                field.scalar_type,
            )?;
        }
    }
    Ok(())
}

/// Writes an array of FIELD.
fn array(
    file: &mut impl Write,
    text: bool,
    name: &str,
    components: usize,
    values: &[f64],
    scalar_type: ScalarType,
) -> std::io::Result<()> {
    // 64-bit types have different names and widths in different programs.
    let narrow = match scalar_type {
        ScalarType::I64 => ScalarType::I32,
        ScalarType::U64 => ScalarType::U32,
        other => other,
    };
    let kind = [narrow, scalar_type]
        .into_iter()
        .find(|kind| scalar::is_lossless(values, *kind))
        .unwrap_or(ScalarType::F64);
    let type_name = match kind {
        ScalarType::I8 => "char",
        ScalarType::U8 => "unsigned_char",
        ScalarType::I16 => "short",
        ScalarType::U16 => "unsigned_short",
        ScalarType::I32 => "int",
        ScalarType::U32 => "unsigned_int",
        ScalarType::I64 => "vtktypeint64",
        ScalarType::U64 => "vtktypeuint64",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    };
    writeln!(
        file,
        "{} {components} {} {type_name}",
        encoded(name),
        values.len() / components
    )?;
    numbers(file, text, values, kind, components)
}

/// Writes numbers as text, `width` per line, or as big-endian bytes.
fn numbers(
    file: &mut impl Write,
    text: bool,
    values: &[f64],
    kind: ScalarType,
    width: usize,
) -> std::io::Result<()> {
    if !text {
        let mut bytes = scalar::encode(values, kind);
        for number in bytes.chunks_exact_mut(scalar::size(kind)) {
            number.reverse();
        }
        file.write_all(&bytes)?;
        return file.write_all(b"\n");
    }
    for tuple in values.chunks(width) {
        for value in tuple {
            match kind {
                ScalarType::F64 => write!(file, "{value:?} ")?,
                ScalarType::F32 => write!(file, "{:?} ", *value as f32)?,
                _ => write!(file, "{value} ")?,
            }
        }
        file.write_all(b"\n")?;
    }
    Ok(())
}
