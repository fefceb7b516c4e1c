//! Conversion of the cells of a file to triangles, shared by all surface readers.

use super::polygon::PolygonCutter;
use super::repair::Triangles;
use crate::io::cursor::ParseResult;
use crate::io::raw_mesh::RawMesh;
use crate::mesh::{AnatomicalFrame, Field, Location, NORMAL, TriMesh, UV};
use glam::DVec3;
use std::collections::HashMap;

/// Converts the surface cells of `raw` to triangles. Long because each kind of cell has its case.
pub(super) fn into_surface(raw: RawMesh) -> ParseResult<TriMesh> {
    let mut surface = TriMesh {
        notes: raw.warnings.clone(),
        ..TriMesh::default()
    };
    let (triangles, cells, dropped) = triangulated(&raw)?;
    if dropped > 0 {
        surface
            .notes
            .push(format!("{dropped} cells that are not polygons dropped"));
    }
    if triangles.is_empty() {
        return Err("file has no triangles or polygons; expected a surface".into());
    }
    if let Some(bad) = used(&triangles).find(|v| !raw.nodes[*v as usize].is_finite()) {
        return Err(format!(
            "vertex {bad} (counted from 0) must have finite coordinates, got {}",
            raw.nodes[bad as usize]
        ));
    }
    let (first, vertices) = merged(&raw.nodes, &triangles);
    if vertices.merged > 0 {
        surface
            .notes
            .push(format!("{} coincident vertices merged", vertices.merged));
    }
    let mut kept = Triangles {
        corners: Vec::new(),
        cells: Vec::new(),
    };
    for (n, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| first[v as usize]);
        let [p, q, r] = [a, b, c].map(|v| vertices.places[v as usize]);
        if a != b && b != c && c != a && (q - p).cross(r - p) != DVec3::ZERO {
            kept.corners.push([a, b, c]);
            kept.cells.push(cells[n]);
        }
    }
    let flat = triangles.len() - kept.corners.len();
    if flat > 0 {
        surface
            .notes
            .push(format!("{flat} triangles with zero area dropped"));
    }
    if kept.corners.is_empty() {
        return Err("all triangles have zero area".into());
    }
    let opposite = repair(&mut kept, &vertices.places, &raw.fields, &mut surface.notes);
    surface.triangles = kept.corners;
    let sources = vertices.sources;
    surface.vertices = vertices.places;
    for field in raw.fields {
        let items = match field.location {
            Location::Node => raw.nodes.len(),
            Location::Cell => raw.cells.len(),
        };
        if field.components == 0 || field.values.len() != items * field.components {
            continue;
        }
        let width = field.components;
        let tuple = |n: u32| {
            let start = n as usize * width;
            &field.values[start..start + width]
        };
        let from = match field.location {
            Location::Node => &sources,
            Location::Cell => &kept.cells,
        };
        let values = from.iter().flat_map(|n| tuple(*n)).copied().collect();
        surface.fields.push(Field { values, ..field });
    }
    if opposite > 0 {
        // Which triangle of a pair comes first says nothing about the outside.
        surface.orient_consistently();
    }
    if let Some(frame) = raw.frame {
        if frame == AnatomicalFrame::Lps {
            surface
                .notes
                .push("converted from LPS, which the file states, to RAS".into());
        }
        surface.convert_to_ras(frame);
    }
    Ok(surface)
}

/// Drops duplicates and closes T-junctions, with notes. Returns the number of dropped triangles
/// that were the opposite of another one.
fn repair(
    kept: &mut Triangles,
    places: &[DVec3],
    fields: &[Field],
    notes: &mut Vec<String>,
) -> usize {
    let dropped = kept.drop_duplicates();
    if dropped.same > 0 {
        notes.push(format!(
            "{} triangles that repeat another one dropped",
            dropped.same
        ));
    }
    if dropped.opposite > 0 {
        notes.push(format!(
            "two-sided surface: {} triangles with the corners of another one in opposite \
            orientation dropped",
            dropped.opposite
        ));
    }
    // The values at the corners of a divided triangle are not those of its parts.
    let corner_values =
        |f: &Field| f.location == Location::Cell && [UV, NORMAL].contains(&f.name.as_str());
    let [closed, left] = kept.close_t_junctions(places, !fields.iter().any(corner_values));
    if closed > 0 {
        notes.push(format!(
            "{closed} T-junctions closed: vertices of other triangles lie on an edge, whose \
            triangle was divided"
        ));
    }
    if left > 0 {
        notes.push(format!(
            "{left} T-junctions left open: vertices of other triangles lie next to an edge and are \
            not joined to it; merge them in the program that made the surface"
        ));
    }
    dropped.opposite
}

fn used(triangles: &[[u32; 3]]) -> impl Iterator<Item = u32> {
    triangles.iter().flatten().copied()
}

/// Returns the triangles of all cells, the cell of each, and the number of non-polygonal cells.
#[allow(clippy::type_complexity)]
fn triangulated(raw: &RawMesh) -> ParseResult<(Vec<[u32; 3]>, Vec<u32>, usize)> {
    let (mut triangles, mut cells, mut dropped) = (Vec::new(), Vec::new(), 0);
    let mut cutter = PolygonCutter::new();
    let mut places = Vec::new();
    let mut cell = 0;
    while let Some((kind, nodes)) = raw.cells.get(cell) {
        if let Some(bad) = nodes.iter().find(|v| **v as usize >= raw.nodes.len()) {
            return Err(format!(
                "face {cell} (counted from 0) refers to vertex {bad}, but there are {} vertices",
                raw.nodes.len()
            ));
        }
        let before = triangles.len();
        match (kind, nodes) {
            (6, nodes) => triangles.extend(nodes.windows(3).enumerate().map(|(n, w)| {
                // Alternate triangles of a strip have opposite orientation.
                match n % 2 {
                    0 => [w[0], w[1], w[2]],
                    _ => [w[1], w[0], w[2]],
                }
            })),
            // The corners of a pixel are in row order.
            (8, [a, b, c, d]) => triangles.extend([[*a, *b, *d], [*a, *d, *c]]),
            (5, [a, b, c]) => triangles.push([*a, *b, *c]),
            (5 | 7 | 9, nodes) => {
                places.clear();
                places.extend(nodes.iter().map(|v| raw.nodes[*v as usize]));
                let parts = cutter.triangles(&places).into_iter();
                triangles.extend(parts.map(|part| part.map(|n| nodes[n])));
            }
            _ => dropped += 1,
        }
        cells.extend(std::iter::repeat_n(cell as u32, triangles.len() - before));
        cell += 1;
    }
    Ok((triangles, cells, dropped))
}

/// The remaining vertices after merging.
struct Merged {
    places: Vec<DVec3>,
    /// The vertex in the file for each.
    sources: Vec<u32>,
    merged: usize,
}

/// Returns the replacement of each vertex of the file: the first at the same position. Unused
/// vertices are dropped.
fn merged(nodes: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<u32>, Merged) {
    let mut first = vec![u32::MAX; nodes.len()];
    let mut at: HashMap<[u64; 3], u32> = HashMap::new();
    let mut vertices = Merged {
        places: Vec::new(),
        sources: Vec::new(),
        merged: 0,
    };
    for v in used(triangles) {
        if first[v as usize] != u32::MAX {
            continue;
        }
        let place = nodes[v as usize];
        // −0 and 0 are the same position.
        let key = (place + DVec3::ZERO).to_array().map(f64::to_bits);
        let next = vertices.places.len() as u32;
        let index = *at.entry(key).or_insert(next);
        if index == next {
            vertices.places.push(place);
            vertices.sources.push(v);
        } else {
            vertices.merged += 1;
        }
        first[v as usize] = index;
    }
    (first, vertices)
}
