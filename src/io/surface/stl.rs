//! Reader for STL, ASCII and binary: a list of triangles.

use crate::io::cursor::{Cursor, ParseResult};
use crate::io::raw_mesh::RawMesh;
use glam::DVec3;

/// VTK number of a triangle.
const TRIANGLE: u8 = 5;
/// Size of the header of a binary file and of each triangle, in bytes.
const HEADER: usize = 84;
const RECORD: usize = 50;

/// Reads the content of an STL file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    // Binary files may begin with "solid", too: the length decides, and that text has no zeros.
    let count = bytes.get(80..HEADER).map(|c| {
        let mut number = [0; 4];
        number.copy_from_slice(c);
        u32::from_le_bytes(number) as usize
    });
    let fits = |n: usize| n.checked_mul(RECORD).and_then(|n| n.checked_add(HEADER));
    let exact = count.and_then(fits) == Some(bytes.len());
    let start = &bytes[..bytes.len().min(1024)];
    let text = start.trim_ascii_start().to_ascii_lowercase();
    let text = text.starts_with(b"solid") && !text.contains(&0);
    if text && !exact {
        return read_text(bytes);
    }
    let Some(count) = count else {
        return Err(format!(
            "binary STL file must have a header of {HEADER} bytes, but the file has {} bytes",
            bytes.len()
        ));
    };
    let there = bytes.len() - HEADER;
    if fits(count).is_none_or(|n| n > bytes.len()) {
        return Err(format!(
            "byte 80: header specifies {count} triangles, but the file has data for {} (wrong \
            count or truncated file)",
            there / RECORD
        ));
    }
    let mut mesh = RawMesh::default();
    if !exact {
        mesh.warnings.push(format!(
            "{} bytes after the last triangle ignored",
            there - count * RECORD
        ));
    }
    for record in bytes[HEADER..].chunks_exact(RECORD).take(count) {
        let number = |n: usize| {
            let mut number = [0; 4];
            number.copy_from_slice(&record[4 * n..4 * n + 4]);
            f64::from(f32::from_le_bytes(number))
        };
        // The normal, numbers 0 to 2, is recomputed from the corners.
        for corner in 1..4 {
            let at = 3 * corner;
            mesh.nodes
                .push(DVec3::new(number(at), number(at + 1), number(at + 2)));
        }
        push_triangle(&mut mesh);
    }
    Ok(mesh)
}

/// Adds a triangle of the last three nodes.
fn push_triangle(mesh: &mut RawMesh) {
    let end = mesh.nodes.len();
    mesh.cells.push(TRIANGLE, end - 3..end);
}

fn read_text(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::new(bytes);
    let mut mesh = RawMesh::default();
    at.rest_of_line(); // solid NAME
    let mut corners = 0;
    let mut ended = false;
    while let Some(token) = at.token() {
        match token.to_ascii_lowercase().as_slice() {
            b"facet" => {
                at.rest_of_line(); // normal x y z
                at.token(); // outer
                at.token(); // loop
                corners = 0;
            }
            b"vertex" => {
                let mut p = [0.0; 3];
                for (axis, value) in ["x", "y", "z"].iter().zip(&mut p) {
                    *value = at.number(format_args!("the {axis} of a vertex"))?;
                }
                mesh.nodes.push(p.into());
                corners += 1;
            }
            b"endloop" => {
                if corners != 3 {
                    return Err(at.error(format_args!("facet must have 3 vertices, got {corners}")));
                }
                push_triangle(&mut mesh);
                corners = 0;
            }
            b"endfacet" => {}
            word @ (b"endsolid" | b"solid") => {
                ended = word == b"endsolid";
                at.rest_of_line();
            }
            other => {
                let shown = String::from_utf8_lossy(&other[..other.len().min(40)]);
                return Err(at.error(format_args!(
                    "expected facet, vertex, endloop, endfacet or endsolid, found {shown:?}"
                )));
            }
        }
    }
    if corners != 0 {
        return Err("unexpected end of file within a facet".into());
    }
    if !ended {
        mesh.warnings
            .push("file does not end with endsolid (possibly truncated)".into());
    }
    Ok(mesh)
}
