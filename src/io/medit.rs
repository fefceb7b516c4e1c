//! Reader for Medit ASCII `.mesh` files.
//!
//! References become the fields `medit:ref` of nodes and cells, the names used by meshio;
//! references that are constant 0 carry no information and are dropped. The middles of the edges of
//! TetrahedraP2 are in VTK's order, unless a section TetrahedraP2Ordering states another one. Sections
//! other than vertices and cells are skipped.

use super::cell_kinds::QUADRATIC_TET;
use super::cursor::{Cursor, ParseResult};
use super::metadata::Metadata;
use super::raw_mesh::{Cells, RawMesh};
use crate::mesh::{Field, Location, ScalarType};
use glam::DVec3;

/// The keyword at the start of every file of this format.
pub(super) const MAGIC: &str = "meshversionformatted";

/// Section, VTK number of its cells, nodes per cell. Corners are first, in VTK order. "Hexaedra" is
/// the spelling of the format's own report, which many programs write.
const SECTIONS: [(&str, u8, usize); 16] = [
    ("tetrahedra", 10, 4),
    ("tetraedra", 10, 4),
    ("hexahedra", 12, 8),
    ("hexaedra", 12, 8),
    ("prisms", 13, 6),
    ("pentahedra", 13, 6),
    ("pentaedra", 13, 6),
    ("wedges", 13, 6),
    ("pyramids", 14, 5),
    ("triangles", 5, 3),
    ("quadrilaterals", 9, 4),
    ("edges", 3, 2),
    ("tetrahedrap2", QUADRATIC_TET, 10),
    ("hexahedraq2", 29, 27),
    ("trianglesp2", 22, 6),
    ("edgesp2", 21, 3),
];

/// Starts of the names of sections that hold neither vertices nor cells, and are skipped silently.
const SILENT: [&str; 12] = [
    "required",
    "corners",
    "ridges",
    "normal",
    "tangent",
    "angleof",
    "geometry",
    "bounding",
    "subdomain",
    "iterations",
    "time",
    "identifier",
];

/// Reads the content of a `.mesh` file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::with_comments(bytes);
    let mut mesh = RawMesh::default();
    let mut node_refs = Vec::new();
    let mut cell_refs = Vec::new();
    let mut ordering = VTK_ORDER;
    let first = at.word(format_args!("MeshVersionFormatted"))?;
    if first.to_ascii_lowercase() != MAGIC {
        let shown: String = first.chars().take(40).collect();
        return Err(at.error(format_args!(
            "expected MeshVersionFormatted, found {shown:?}"
        )));
    }
    at.integer(format_args!("the format's version"))?;
    loop {
        let Some(token) = at.token() else {
            mesh.warnings
                .push("file does not end with the keyword End (possibly truncated)".into());
            break;
        };
        let keyword = String::from_utf8_lossy(token).to_ascii_lowercase();
        if keyword == "end" {
            break;
        } else if keyword == "dimension" {
            let dimension = at.integer(format_args!("the dimension"))?;
            if dimension != 3 {
                return Err(at.error(format_args!(
                    "the mesh has dimension {dimension}, expected 3"
                )));
            }
        } else if keyword == "vertices" {
            read_vertices(&mut at, &mut mesh, &mut node_refs)?;
        } else if keyword == "tetrahedrap2ordering" {
            ordering = read_ordering(&mut at)?;
        } else if let Some((_, kind, width)) = SECTIONS.iter().find(|s| s.0 == keyword) {
            read_cells(&mut at, &keyword, *kind, *width, &mut mesh, &mut cell_refs)?;
        } else if ["tetra", "hexa", "prisms", "penta", "wedges", "pyramids"]
            .iter()
            .any(|solid| keyword.starts_with(solid))
        {
            return Err(at.error(format_args!(
                "cells of section {keyword} are not supported; use linear cells, TetrahedraP2 or \
                HexahedraQ2"
            )));
        } else if is_keyword(token) {
            if !SILENT.iter().any(|start| keyword.starts_with(start)) {
                let name: String = String::from_utf8_lossy(token).chars().take(40).collect();
                mesh.warnings.push(format!("section {name} skipped"));
            }
            pass_over(&mut at);
        } else {
            let shown: String = keyword.chars().take(40).collect();
            return Err(at.error(format_args!("expected a keyword, found {shown:?}")));
        }
    }
    if mesh.nodes.is_empty() {
        return Err("file has no Vertices section".into());
    }
    if ordering != VTK_ORDER {
        mesh.cells = reordered(&mesh.cells, ordering);
    }
    keep_refs(&mut mesh, Location::Node, node_refs);
    Metadata::read(bytes, "# ").add_to(&mut mesh, &cell_refs);
    keep_refs(&mut mesh, Location::Cell, cell_refs);
    Ok(mesh)
}

fn read_vertices(at: &mut Cursor, mesh: &mut RawMesh, refs: &mut Vec<f64>) -> ParseResult<()> {
    if !mesh.nodes.is_empty() {
        return Err(at.error("file has a second Vertices section; expected one"));
    }
    let count = at.count(format_args!("the number of Vertices"), 8)?;
    mesh.nodes.reserve(count);
    for i in 1..=count {
        let mut position = [0.0; 3];
        for x in &mut position {
            *x = at.number(format_args!("a coordinate of vertex {i} of {count}"))?;
        }
        mesh.nodes.push(DVec3::from_array(position));
        refs.push(reference(at, format_args!("vertex {i} of {count}"))?);
    }
    Ok(())
}

fn read_cells(
    at: &mut Cursor,
    keyword: &str,
    kind: u8,
    width: usize,
    mesh: &mut RawMesh,
    refs: &mut Vec<f64>,
) -> ParseResult<()> {
    let count = at.count(format_args!("the number of {keyword}"), 2 * width)?;
    for i in 1..=count {
        let mut nodes = [0; 27];
        for node in &mut nodes[..width] {
            let vertex = at.integer(format_args!("a vertex of {keyword} {i} of {count}"))?;
            *node = usize::try_from(vertex)
                .ok()
                .and_then(|v| v.checked_sub(1))
                .filter(|v| *v < mesh.nodes.len())
                .ok_or_else(|| {
                    at.error(format_args!(
                        "{keyword} {i} refers to vertex {vertex}, but there are {} Vertices so far (counted from 1)",
                        mesh.nodes.len()
                    ))
                })?;
        }
        mesh.cells.push(kind, nodes[..width].iter().copied());
        refs.push(reference(at, format_args!("{keyword} {i} of {count}"))?);
    }
    Ok(())
}

/// The places of the nodes of ten-node tets in VTK's order.
const VTK_ORDER: [usize; 10] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9];

/// Reads the section that states the order of the nodes of ten-node tets by their barycentric
/// coordinates times 2. Returns the place of each node of VTK's order.
fn read_ordering(at: &mut Cursor) -> ParseResult<[usize; 10]> {
    const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];
    let count = at.count(
        format_args!("the number of nodes in TetrahedraP2Ordering"),
        8,
    )?;
    let mut places = [None; 10];
    for i in 0..count {
        let mut weights = [0; 4];
        for weight in &mut weights {
            *weight = at.integer(format_args!("a coordinate of node {} of {count}", i + 1))?;
        }
        let corner = (0..4).find(|a| weights[*a] == 2);
        let edge = EDGES
            .iter()
            .position(|edge| edge.iter().all(|a| weights[*a] == 1));
        let place = corner.or(edge.map(|edge| 4 + edge));
        if let Some(place) = place.filter(|_| weights.iter().sum::<i64>() == 2) {
            places[place] = Some(i);
        }
    }
    let all: Vec<usize> = places.into_iter().flatten().collect();
    let all = <[usize; 10]>::try_from(all).ok().filter(|_| count == 10);
    all.ok_or_else(|| {
        at.error(
            "TetrahedraP2Ordering must have the 4 corners (2 0 0 0 …) and the 6 edges (1 1 0 0 …) of a tetrahedron once each",
        )
    })
}

/// Returns cells with the nodes of ten-node tets at `places` in VTK's order.
fn reordered(cells: &Cells, places: [usize; 10]) -> Cells {
    let mut sorted = Cells::default();
    for (kind, nodes) in cells.iter() {
        match kind {
            QUADRATIC_TET => sorted.push(kind, places.map(|place| nodes[place] as usize)),
            _ => sorted.push(kind, nodes.iter().map(|v| *v as usize)),
        }
    }
    sorted
}

/// Reads a reference. It should be an integer, but some programs write it as "1.0".
fn reference(at: &mut Cursor, of: std::fmt::Arguments) -> ParseResult<f64> {
    let value = at.number(format_args!("the reference of {of}"))?;
    match value.is_finite() {
        true => Ok(value),
        false => Err(at.error(format_args!(
            "the reference of {of} is {value}, expected an integer"
        ))),
    }
}

fn is_keyword(token: &[u8]) -> bool {
    token[0].is_ascii_alphabetic() && super::cursor::number(token).is_none()
}

/// Skips to the next keyword.
fn pass_over(at: &mut Cursor) {
    while at.peek().is_some_and(|t| !is_keyword(t)) {
        at.token();
    }
}

fn keep_refs(mesh: &mut RawMesh, location: Location, values: Vec<f64>) {
    if values.iter().any(|v| *v != 0.0) {
        mesh.fields.push(Field {
            name: "medit:ref".into(),
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
