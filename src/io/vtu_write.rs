//! Writer for VTK XML unstructured grids: appended raw data in zlib-compressed blocks,
//! little-endian, UInt64 headers; the default of VTK and ParaView.

use super::scalar;
use super::ten_node::FileMesh;
use super::vtk_regions::{self, Values};
use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::parallel;
use crate::{Error, Result};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::DVec3;
use std::borrow::Cow;
use std::io::Write;
use std::path::Path;

/// Size of a compressed block in bytes.
const BLOCK: usize = 1 << 18;

/// Writes the tets of `mesh` (of order 2 the ten-node tets) with nodes at `nodes`, the mesh's fields
/// and `extra` ones (which replace those of the mesh of the same name).
///
/// # Errors
/// An error for positions or fields of the wrong length, or if the file cannot be written.
pub(super) fn write(path: &Path, mesh: &TetMesh, nodes: &[DVec3], extra: &[Field]) -> Result<()> {
    write_with_array(path, mesh, nodes, extra, None)
}

/// As [`write`], with additional bytes stored for the whole mesh under a name.
pub(super) fn write_with_array(
    path: &Path,
    mesh: &TetMesh,
    nodes: &[DVec3],
    extra: &[Field],
    extra_array: Option<(&str, &[u8])>,
) -> Result<()> {
    if nodes.len() != mesh.nodes.len() {
        return Err(Error::Mesh(format!(
            "got {} positions for {} nodes",
            nodes.len(),
            mesh.nodes.len()
        )));
    }
    let items = |f: &Field| match f.location {
        Location::Node => nodes.len(),
        Location::Cell => mesh.tets.len(),
    };
    extra.iter().try_for_each(|f| check_length(f, items(f)))?;
    let file_mesh = FileMesh::new(mesh);
    let extra: Vec<Cow<Field>> = extra.iter().map(|f| file_mesh.field(mesh, f)).collect();
    let mesh = &*file_mesh.mesh;
    let replaced = |f: &Field| {
        extra
            .iter()
            .any(|e| e.name == f.name && e.location == f.location)
    };
    let fields: Vec<&Field> = mesh
        .fields
        .iter()
        .filter(|f| !replaced(f))
        .chain(extra.iter().map(|f| &**f))
        .collect();
    let mut appended = Vec::new();
    let mut head = format!(
        "<?xml version=\"1.0\"?>\n{}<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n{}<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n",
        frame_comment(mesh),
        global(mesh, extra_array),
        nodes.len(),
        mesh.tets.len()
    );
    for (section, location, items) in [
        ("PointData", Location::Node, nodes.len()),
        ("CellData", Location::Cell, mesh.tets.len()),
    ] {
        head += &format!("<{section}>\n");
        for field in fields.iter().filter(|f| f.location == location) {
            field_array(&mut head, &mut appended, field, items)?;
        }
        head += &format!("</{section}>\n");
    }
    topology_arrays(&mut head, &mut appended, &file_mesh, nodes)?;
    head += "</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_";
    super::atomic_write(path, |file| {
        let mut put = |bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
        put(head.as_bytes())?;
        put(&appended)?;
        put(b"\n</AppendedData>\n</VTKFile>\n")
    })
}

/// Checks that a field has the values of `items` nodes or cells.
fn check_length(field: &Field, items: usize) -> Result<()> {
    if items.checked_mul(field.components) != Some(field.values.len()) {
        return Err(Error::Mesh(format!(
            "field \"{}\" has {} values, which does not match {items} {} of {} components",
            field.name,
            field.values.len(),
            field.location,
            field.components
        )));
    }
    Ok(())
}

/// Adds the array of a field of `items` nodes or cells.
fn field_array(
    head: &mut String,
    appended: &mut Vec<u8>,
    field: &Field,
    items: usize,
) -> Result<()> {
    check_length(field, items)?;
    let exact = scalar::is_lossless(&field.values, field.scalar_type);
    let kind = if exact {
        field.scalar_type
    } else {
        ScalarType::F64
    };
    let data = scalar::encode(&field.values, kind);
    array(head, appended, &field.name, kind, field.components, &data)
}

/// Adds the arrays of the node positions and of the tets.
fn topology_arrays(
    head: &mut String,
    appended: &mut Vec<u8>,
    mesh: &FileMesh,
    nodes: &[DVec3],
) -> Result<()> {
    let positions: Vec<u8> = nodes
        .iter()
        .flat_map(|p| p.to_array())
        .flat_map(f64::to_le_bytes)
        .collect();
    let count = mesh.mesh.tets.len();
    let corners: Vec<u8> = mesh
        .cells()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let width = mesh.width() as u64;
    let ends: Vec<u8> = (1..=count as u64)
        .flat_map(|t| (width * t).to_le_bytes())
        .collect();
    let kinds = vec![mesh.kind(); count];
    *head += "<Points>\n";
    array(head, appended, "Points", ScalarType::F64, 3, &positions)?;
    *head += "</Points>\n<Cells>\n";
    array(head, appended, "connectivity", ScalarType::I32, 1, &corners)?;
    array(head, appended, "offsets", ScalarType::I64, 1, &ends)?;
    array(head, appended, "types", ScalarType::U8, 1, &kinds)?;
    *head += "</Cells>\n";
    Ok(())
}

/// Returns the comment that states the frame of reference, if it is known.
fn frame_comment(mesh: &TetMesh) -> String {
    mesh.frame
        .map_or(String::new(), |f| format!("<!-- {} -->\n", f.statement()))
}

/// Returns the tags of the whole mesh; empty if there are no data.
fn global(mesh: &TetMesh, extra_array: Option<(&str, &[u8])>) -> String {
    let tag = |name: &str, kind: &str, count: usize, text: String| {
        let name = escaped(name);
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfTuples=\"{count}\" format=\"ascii\">{text}</DataArray>\n"
        )
    };
    let extra_array = extra_array.map(|(name, bytes)| {
        let words: Vec<String> = bytes.iter().map(u8::to_string).collect();
        tag(name, "UInt8", bytes.len(), words.join(" "))
    });
    let tags: String = vtk_regions::arrays(mesh)
        .into_iter()
        .map(|(name, values)| {
            let (kind, count, text) = match values {
                Values::Real(value) => ("Float64", 1, value.to_string()),
                Values::Labels(labels) => {
                    let words: Vec<String> = labels.iter().map(i64::to_string).collect();
                    ("Int64", labels.len(), words.join(" "))
                }
            };
            tag(&name, kind, count, text)
        })
        .chain(extra_array)
        .collect();
    match tags.is_empty() {
        true => tags,
        false => format!("<FieldData>\n{tags}</FieldData>\n"),
    }
}

/// Adds the tag of an array to `head` and its compressed bytes to `appended`.
fn array(
    head: &mut String,
    appended: &mut Vec<u8>,
    name: &str,
    kind: ScalarType,
    components: usize,
    data: &[u8],
) -> Result<()> {
    // A single component is the default; meshio would read it as a matrix.
    let width = match components {
        1 => String::new(),
        _ => format!(" NumberOfComponents=\"{components}\""),
    };
    *head += &format!(
        "<DataArray type=\"{}\" Name=\"{}\"{width} format=\"appended\" offset=\"{}\"/>\n",
        scalar::vtk_xml_name(kind),
        escaped(name),
        appended.len()
    );
    let blocks: Vec<&[u8]> = data.chunks(BLOCK).collect();
    let blocks = parallel::map_coarse(blocks.len(), |b| {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(blocks[b])?;
        encoder.finish()
    });
    let blocks: Vec<Vec<u8>> = blocks
        .into_iter()
        .collect::<std::io::Result<_>>()
        .map_err(|e| Error::Input(format!("cannot compress array \"{name}\": {e}")))?;
    let last = data.len() % BLOCK;
    let header = [blocks.len(), BLOCK, last];
    for number in header.into_iter().chain(blocks.iter().map(Vec::len)) {
        appended.extend((number as u64).to_le_bytes());
    }
    blocks.iter().for_each(|block| appended.extend(block));
    Ok(())
}

/// Escapes `text` as the value of an XML attribute; white space other than blanks is escaped, as
/// readers normalise it, and characters not allowed in XML become U+FFFD.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' | '>' | '&' | '"' | '\'' | '\t' | '\n' | '\r' => {
                out += &format!("&#{};", u32::from(c));
            }
            '\0'..' ' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            _ => out.push(c),
        }
    }
    out
}
