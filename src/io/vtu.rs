//! Reader for VTK XML unstructured grids (`.vtu`) and surfaces (`.vtp`): ASCII, inline base64,
//! appended raw and base64, uncompressed or compressed by zlib, LZ4 or LZMA, both header widths,
//! both byte orders. Several pieces are joined as those of a `.pvtu`.
//!
//! The `vtkio` crate (0.6.3) was tested on real files and on the output of VTK 9: it panics on
//! appended base64 of older VTK, and rejects appended raw data and compressed arrays of more than
//! one block, so this is a separate reader, based on quick-xml, base64, flate2, lz4_flex and
//! lzma-rs.

use super::cell_kinds::{POLYHEDRON, polygon_kind};
use super::cursor::ParseResult;
use super::join::join;
use super::raw_mesh::{RawMesh, index};
use super::vtk_xml::{Outline, Piece, section_of};
use crate::mesh::{AnatomicalFrame, Field, Location};
use glam::DVec3;

/// Types of files with cells, in the first tag.
const KINDS: [&str; 2] = ["UnstructuredGrid", "PolyData"];

/// Sections of the cells of a surface, in the order of their numbers.
const POLYGONAL: [(&str, &str); 4] = [
    ("Verts", "NumberOfVerts"),
    ("Lines", "NumberOfLines"),
    ("Polys", "NumberOfPolys"),
    ("Strips", "NumberOfStrips"),
];

/// Reads the content of a `.vtu` or `.vtp` file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut mesh = mesh_of(&Outline::read(bytes, &KINDS)?)?;
    mesh.frame = AnatomicalFrame::stated_in(bytes);
    Ok(mesh)
}

/// As [`read`]; also returns the bytes stored for the whole mesh under `name`, if any.
pub(super) fn read_with_array(bytes: &[u8], name: &str) -> ParseResult<(RawMesh, Option<Vec<u8>>)> {
    let outline = Outline::read(bytes, &KINDS)?;
    let byte = |x: &f64| (x.fract() == 0.0 && (0.0..256.0).contains(x)).then_some(*x as u8);
    let values = outline.global_array(name);
    let values = values.and_then(|numbers| numbers.iter().map(byte).collect());
    let mut mesh = mesh_of(&outline)?;
    mesh.frame = AnatomicalFrame::stated_in(bytes);
    Ok((mesh, values))
}

fn mesh_of(outline: &Outline) -> ParseResult<RawMesh> {
    let count = outline.pieces.len();
    let pieces = outline.pieces.iter().enumerate().map(|(number, piece)| {
        piece_of(outline, piece).map_err(|e| match count {
            1 => e,
            _ => format!("piece {number} (counted from 0): {e}"),
        })
    });
    let mut pieces: Vec<RawMesh> = pieces.collect::<ParseResult<_>>()?;
    let mut mesh = match pieces.len() {
        1 => pieces.remove(0),
        _ => {
            let nodes: usize = pieces.iter().map(|piece| piece.nodes.len()).sum();
            let mut mesh = join(pieces)?;
            let merged = nodes - mesh.nodes.len();
            if merged > 0 {
                let note = format!("{count} pieces joined at {merged} nodes that several have");
                mesh.warnings.push(note);
            }
            mesh
        }
    };
    mesh.warnings.splice(0..0, outline.warnings.iter().cloned());
    outline.global().add_to(&mut mesh);
    Ok(mesh)
}

fn piece_of(outline: &Outline, piece: &Piece) -> ParseResult<RawMesh> {
    let mut mesh = RawMesh::default();
    let nodes = piece.count("NumberOfPoints")?;
    let points = piece.arrays.iter().find(|a| a.section == "Points");
    match points {
        Some(array) if array.components != 3 => {
            return Err(format!(
                "<Points> has {} components, expected 3",
                array.components
            ));
        }
        Some(array) => {
            let (values, _) = outline.values(array, Some(nodes))?;
            let positions = values.as_chunks().0.iter();
            mesh.nodes.extend(positions.map(|p| DVec3::from_array(*p)));
        }
        None if nodes == 0 => {}
        None => return Err("no coordinates in <Points>".into()),
    }
    match outline.kind.as_str() {
        "PolyData" => add_polygons(outline, piece, &mut mesh)?,
        _ => add_cells(outline, piece, &mut mesh)?,
    }
    let items = [
        (Location::Node, mesh.nodes.len()),
        (Location::Cell, mesh.cells.len()),
    ];
    for (location, items) in items {
        let section = section_of(location);
        for array in piece.arrays.iter().filter(|a| a.section == section) {
            match outline.attribute_values(array, Some(items)) {
                Ok((values, scalar_type)) => mesh.fields.push(Field {
                    name: array.name.clone(),
                    location,
                    components: array.components,
                    values,
                    scalar_type,
                }),
                Err(e) => mesh
                    .warnings
                    .push(format!("array \"{}\" skipped: {e}", array.name)),
            }
        }
    }
    Ok(mesh)
}

/// Adds the cells of a piece of an unstructured grid.
fn add_cells(outline: &Outline, piece: &Piece, mesh: &mut RawMesh) -> ParseResult<()> {
    let count = piece.count("NumberOfCells")?;
    if count == 0 {
        return Ok(());
    }
    let kinds = numbers_of(outline, piece, "Cells", "types", Some(count))?;
    let (mut nodes, mut ends) = node_lists(outline, piece, "Cells", count)?;
    if kinds.contains(&f64::from(POLYHEDRON)) {
        let streams = face_streams(outline, piece, count)?;
        (nodes, ends) = with_streams(&kinds, &nodes, &ends, &streams);
    }
    mesh.add_cells(&kinds, &nodes, &ends)
}

/// Adds the cells of a piece of a surface.
fn add_polygons(outline: &Outline, piece: &Piece, mesh: &mut RawMesh) -> ParseResult<()> {
    for (section, attribute) in POLYGONAL {
        let count = match piece.text(attribute) {
            Some(_) => piece.count(attribute)?,
            None => 0,
        };
        if count == 0 {
            continue;
        }
        let (nodes, ends) = node_lists(outline, piece, section, count)?;
        let mut start = 0;
        let kinds: Vec<f64> = ends
            .iter()
            .map(|end| {
                let kind = polygon_kind(section, end - start);
                start = *end;
                f64::from(kind)
            })
            .collect();
        mesh.add_cells(&kinds, &nodes, &ends)?;
    }
    Ok(())
}

/// Reads the nodes of the cells of a section, and the end of each cell's nodes.
fn node_lists(
    outline: &Outline,
    piece: &Piece,
    section: &str,
    count: usize,
) -> ParseResult<(Vec<f64>, Vec<usize>)> {
    let points = piece.count("NumberOfPoints")?;
    let offsets = numbers_of(outline, piece, section, "offsets", Some(count))?;
    let ends = ends(&offsets, "offsets")?;
    let last = ends.last().copied().unwrap_or(0);
    let nodes = numbers_of(outline, piece, section, "connectivity", Some(last))?;
    if let Some(bad) = nodes.iter().find(|v| **v >= points as f64) {
        return Err(format!(
            "array \"connectivity\" refers to node {bad}, but there are only {points} nodes (counted from 0)"
        ));
    }
    Ok((nodes, ends))
}

fn numbers_of(
    outline: &Outline,
    piece: &Piece,
    section: &str,
    name: &str,
    count: Option<usize>,
) -> ParseResult<Vec<f64>> {
    let array = piece.array(section, name);
    let array = array.ok_or_else(|| format!("no array \"{name}\" in <{section}>"))?;
    Ok(outline.values(array, count)?.0)
}

/// Returns the faces of each cell as its number of faces and, for each, its number of nodes and its
/// nodes; empty for other cells than polyhedra.
fn face_streams(outline: &Outline, piece: &Piece, count: usize) -> ParseResult<Vec<Vec<f64>>> {
    let of = |name: &str, count: Option<usize>| numbers_of(outline, piece, "Cells", name, count);
    let mut streams = Vec::with_capacity(count);
    if piece.array("Cells", "polyhedron_to_faces").is_some() {
        // VTK 9.4 and later.
        let face_ends = ends(&of("face_offsets", None)?, "face_offsets")?;
        let nodes = of("face_connectivity", None)?;
        let cell_ends = ends(
            &of("polyhedron_offsets", Some(count))?,
            "polyhedron_offsets",
        )?;
        let faces = of("polyhedron_to_faces", None)?;
        let mut start = 0;
        for (cell, end) in cell_ends.iter().enumerate() {
            let wrong = || format!("faces of cell {cell} (counted from 0) do not exist");
            let own = faces.get(start..*end).ok_or_else(wrong)?;
            start = *end;
            let mut stream = vec![own.len() as f64];
            for face in own {
                let face = index(*face)
                    .filter(|f| *f < face_ends.len())
                    .ok_or_else(wrong)?;
                let first = face.checked_sub(1).map_or(0, |before| face_ends[before]);
                let corners = nodes.get(first..face_ends[face]).ok_or_else(wrong)?;
                stream.push(corners.len() as f64);
                stream.extend(corners);
            }
            streams.push(stream);
        }
    } else if piece.array("Cells", "faces").is_some() {
        let faces = of("faces", None)?;
        let mut start = 0;
        for (cell, end) in of("faceoffsets", Some(count))?.iter().enumerate() {
            // Other cells have the offset −1.
            if *end < 0.0 {
                streams.push(Vec::new());
                continue;
            }
            let stream = index(*end).and_then(|end| faces.get(start..end));
            let stream = stream.ok_or_else(|| {
                format!(
                    "array \"faceoffsets\": entry {cell} is {end}, expected an integer from \
                    {start} to the {} entries of \"faces\"",
                    faces.len()
                )
            })?;
            start += stream.len();
            streams.push(stream.to_vec());
        }
    } else {
        streams.resize(count, Vec::new());
    }
    Ok(streams)
}

/// Returns the node lists of cells with those of polyhedra replaced by their faces.
fn with_streams(
    kinds: &[f64],
    nodes: &[f64],
    ends: &[usize],
    streams: &[Vec<f64>],
) -> (Vec<f64>, Vec<usize>) {
    let (mut all, mut all_ends) = (Vec::with_capacity(nodes.len()), Vec::new());
    let mut start = 0;
    for ((kind, end), stream) in kinds.iter().zip(ends).zip(streams) {
        all.extend_from_slice(match *kind == f64::from(POLYHEDRON) {
            true => stream,
            false => &nodes[start..*end],
        });
        start = *end;
        all_ends.push(all.len());
    }
    (all, all_ends)
}

/// Converts offsets to ascending ends.
fn ends(offsets: &[f64], name: &str) -> ParseResult<Vec<usize>> {
    let mut last = 0;
    offsets
        .iter()
        .enumerate()
        .map(|(cell, offset)| {
            last = index(*offset).filter(|o| *o >= last).ok_or_else(|| {
                format!("array \"{name}\": entry {cell} is {offset}, expected an integer ≥ {last}")
            })?;
            Ok(last)
        })
        .collect()
}
