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
    // Binary files may begin with "solid", too: the length decides, and text has no zeros.
    let count = bytes.get(80..HEADER).map(|c| {
        let mut number = [0; 4];
        number.copy_from_slice(c);
        u32::from_le_bytes(number) as usize
    });
    let fits = |n: usize| n.checked_mul(RECORD).and_then(|n| n.checked_add(HEADER));
    let exact = count.and_then(fits) == Some(bytes.len());
    if !exact && is_text(bytes) {
        return read_text(bytes);
    }
    let Some(count) = count else {
        return Err(format!(
            "binary STL file must have a header of {HEADER} bytes, but the file has {} bytes",
            bytes.len()
        ));
    };
    let there = bytes.len() - HEADER;
    let mut mesh = RawMesh::default();
    // Programs that write triangles as they find them leave the count at 0.
    let is_uncounted = count == 0 && there >= RECORD;
    let count = if is_uncounted { there / RECORD } else { count };
    if is_uncounted {
        mesh.warnings.push(format!(
            "header specifies 0 triangles; all {count} in the file read"
        ));
    }
    if fits(count).is_none_or(|n| n > bytes.len()) {
        return Err(format!(
            "byte 80: header specifies {count} triangles, but the file has data for {} (wrong \
            count or truncated file)",
            there / RECORD
        ));
    }
    let exact = there == count * RECORD;
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

/// Whether this is text: it has no zeros at its start, and begins with `solid`, or has facets after
/// lines of another kind.
fn is_text(bytes: &[u8]) -> bool {
    let start = bytes[..bytes.len().min(4096)].to_ascii_lowercase();
    let has = |word: &[u8]| start.windows(word.len()).any(|w| w == word);
    let head = &start[..start.len().min(1024)];
    !head.contains(&0)
        && (head.trim_ascii_start().starts_with(b"solid") || (has(b"facet") && has(b"vertex")))
}

/// Adds a triangle of the last three nodes.
fn push_triangle(mesh: &mut RawMesh) {
    let end = mesh.nodes.len();
    mesh.cells.push(TRIANGLE, end - 3..end);
}

/// Adds the triangle of a facet with that many corners, and starts the next one.
fn end_facet(at: &Cursor, mesh: &mut RawMesh, corners: &mut usize) -> ParseResult<()> {
    if *corners != 3 {
        return Err(at.error(format_args!("facet must have 3 vertices, got {corners}")));
    }
    push_triangle(mesh);
    *corners = 0;
    Ok(())
}

/// Skips the lines before the facets: the first begins with `solid`, unless another program put its
/// own before it.
fn skip_head(at: &mut Cursor, mesh: &mut RawMesh) {
    let mut skipped = 0;
    loop {
        at.skip_space();
        let start = at.position();
        let line = at.rest_of_line().to_ascii_lowercase();
        if line.starts_with(b"facet") {
            at.go_to(start);
            break;
        }
        if line.starts_with(b"solid") || at.rest().is_empty() {
            break;
        }
        skipped += 1;
    }
    if skipped > 0 {
        mesh.warnings
            .push(format!("{skipped} lines before \"solid\" skipped"));
    }
}

fn read_text(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::new(bytes);
    let mut mesh = RawMesh::default();
    skip_head(&mut at, &mut mesh);
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
            b"endloop" => end_facet(&at, &mut mesh, &mut corners)?,
            b"endfacet" => {}
            // Some programs write the ends as two words.
            b"end" => match at
                .token()
                .unwrap_or_default()
                .to_ascii_lowercase()
                .as_slice()
            {
                b"loop" => end_facet(&at, &mut mesh, &mut corners)?,
                b"solid" => {
                    ended = true;
                    at.rest_of_line();
                }
                // A truncated file is reported below.
                _ => {}
            },
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
