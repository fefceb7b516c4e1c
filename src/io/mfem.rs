//! Reader for MFEM meshes, "MFEM mesh v1.0" to "v1.3" (`.mesh`).
//!
//! Attributes become the cell field `mfem:attribute`. A curved mesh is reduced to its vertices.

use super::cursor::{Cursor, ParseResult, number};
use super::metadata::integer_field;
use super::raw_mesh::RawMesh;
use glam::DVec3;

/// The start of every file of this format, in lower case.
pub(super) const MAGIC: &str = "mfem ";

/// VTK number and nodes of each geometry: point, segment, triangle, square, tetrahedron, cube,
/// prism, pyramid.
const GEOMETRIES: [(u8, usize); 8] = [
    (1, 1),
    (3, 2),
    (5, 3),
    (9, 4),
    (10, 4),
    (12, 8),
    (13, 6),
    (14, 5),
];

/// Families of curved meshes whose first values are those of the vertices.
const NODAL: [&str; 4] = ["H1_", "Linear", "Quadratic", "Cubic"];

/// Reads the content of a file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::with_comments(bytes);
    at.word(format_args!("MFEM"))?;
    let kind = at.word(format_args!("the kind of MFEM mesh"))?;
    let version = at.word(format_args!("the version of the format"))?;
    if kind != "mesh" || !version.starts_with("v1.") {
        let shown: String = format!("{kind} {version}").chars().take(40).collect();
        return Err(at.error(format_args!(
            "MFEM meshes of the kind {shown:?} are not supported, only \"MFEM mesh v1.0\" to \
            \"v1.3\"; save the mesh as VTU with MFEM (Mesh::PrintVTU)"
        )));
    }
    let mut mesh = RawMesh::default();
    let mut attributes = Vec::new();
    let mut vertices = 0;
    while let Some(token) = at.token() {
        match token {
            b"dimension" => {
                at.integer(format_args!("the dimension"))?;
            }
            b"elements" => read_cells(&mut at, "element", &mut mesh, &mut attributes)?,
            b"boundary" => read_cells(&mut at, "boundary element", &mut mesh, &mut attributes)?,
            b"vertices" => {
                vertices = at.count(format_args!("the number of vertices"), 0)?;
                // The vertices of a curved mesh are in its section "nodes".
                if at.peek().is_some_and(|t| number(t).is_some()) {
                    read_vertices(&mut at, vertices, &mut mesh)?;
                }
            }
            b"nodes" => read_curved(&mut at, vertices, &mut mesh)?,
            b"mfem_mesh_end" => break,
            other => {
                let name: String = String::from_utf8_lossy(other).chars().take(40).collect();
                if !other[0].is_ascii_alphabetic() {
                    return Err(at.error(format_args!(
                        "expected the name of a section, found {name:?}"
                    )));
                }
                mesh.warnings.push(format!("section {name} skipped"));
                while at.peek().is_some_and(|t| !is_section(t)) {
                    at.token();
                }
            }
        }
    }
    if mesh.nodes.is_empty() {
        return Err("file has no vertices".into());
    }
    if attributes.iter().any(|a| *a != 0.0) {
        mesh.fields
            .push(integer_field("mfem:attribute", attributes));
    }
    Ok(mesh)
}

fn is_section(token: &[u8]) -> bool {
    let known: [&[u8]; 6] = [
        b"dimension",
        b"elements",
        b"boundary",
        b"vertices",
        b"nodes",
        b"mfem_mesh_end",
    ];
    known.contains(&token)
}

/// Reads cells: attribute, geometry and vertices of each.
fn read_cells(
    at: &mut Cursor,
    what: &str,
    mesh: &mut RawMesh,
    attributes: &mut Vec<f64>,
) -> ParseResult<()> {
    let count = at.count(format_args!("the number of {what}s"), 6)?;
    for i in 1..=count {
        let attribute = at.integer(format_args!("the attribute of {what} {i} of {count}"))?;
        let geometry = at.integer(format_args!("the geometry of {what} {i} of {count}"))?;
        let shape = usize::try_from(geometry).ok();
        let Some((kind, width)) = shape.and_then(|g| GEOMETRIES.get(g)) else {
            return Err(at.error(format_args!(
                "the geometry of {what} {i} is {geometry}, expected 0 to {}",
                GEOMETRIES.len() - 1
            )));
        };
        let mut corners = [0; 8];
        for corner in &mut corners[..*width] {
            let vertex = at.integer(format_args!("a vertex of {what} {i} of {count}"))?;
            *corner = usize::try_from(vertex).map_err(|_| {
                at.error(format_args!(
                    "{what} {i} refers to vertex {vertex}, expected an integer ≥ 0"
                ))
            })?;
        }
        mesh.cells.push(*kind, corners[..*width].iter().copied());
        attributes.push(attribute as f64);
    }
    Ok(())
}

fn check_dimension(at: &Cursor, dimension: i64) -> ParseResult<()> {
    match dimension {
        3 => Ok(()),
        _ => Err(at.error(format_args!(
            "vertices have {dimension} coordinates, expected 3"
        ))),
    }
}

fn read_vertices(at: &mut Cursor, count: usize, mesh: &mut RawMesh) -> ParseResult<()> {
    let dimension = at.integer(format_args!("the number of coordinates"))?;
    check_dimension(at, dimension)?;
    for i in 0..count {
        let mut position = [0.0; 3];
        for x in &mut position {
            *x = at.number(format_args!("a coordinate of vertex {i} (counted from 0)"))?;
        }
        mesh.nodes.push(DVec3::from_array(position));
    }
    Ok(())
}

/// Reads the positions of a curved mesh, and keeps those of the vertices.
fn read_curved(at: &mut Cursor, vertices: usize, mesh: &mut RawMesh) -> ParseResult<()> {
    let mut words = Vec::new();
    for expected in [
        "FiniteElementSpace",
        "FiniteElementCollection:",
        "VDim:",
        "Ordering:",
    ] {
        let word = at.word(format_args!("{expected}"))?;
        if word != expected {
            let shown: String = word.chars().take(40).collect();
            return Err(at.error(format_args!("expected {expected}, found {shown:?}")));
        }
        if expected.ends_with(':') {
            words.push(at.word(format_args!("the value of {expected}"))?);
        }
    }
    let family: String = words[0].chars().take(40).collect();
    if !NODAL.iter().any(|start| family.starts_with(start)) {
        return Err(at.error(format_args!(
            "nodes of the collection {family:?} are not supported, only continuous ones (H1); save \
            the mesh as VTU with MFEM (Mesh::PrintVTU)"
        )));
    }
    check_dimension(at, words[1].parse().unwrap_or(0))?;
    let interleaved = words[2] == "1";
    let mut values = Vec::new();
    while at.peek().is_some_and(|t| number(t).is_some()) {
        values.push(at.number(format_args!("a coordinate of a node"))?);
    }
    let all = values.len() / 3;
    if vertices > all || values.len() % 3 != 0 {
        return Err(at.error(format_args!(
            "section nodes has {} numbers, expected three for each of at least {vertices} vertices",
            values.len()
        )));
    }
    mesh.nodes = (0..vertices)
        .map(|i| match interleaved {
            true => DVec3::new(values[3 * i], values[3 * i + 1], values[3 * i + 2]),
            false => DVec3::new(values[i], values[all + i], values[2 * all + i]),
        })
        .collect();
    if all > vertices {
        mesh.warnings.push(format!(
            "curved cells reduced to their corners; {} other nodes dropped",
            all - vertices
        ));
    }
    Ok(())
}
