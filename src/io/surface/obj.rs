//! Reader for Wavefront OBJ: positions and polygons. Groups, materials, texture coordinates and
//! normals are passed over.

use crate::io::cells::RawMesh;
use crate::io::cursor::{Cursor, Parse, integer};

/// VTK's number for a polygon.
const POLYGON: u8 = 7;

/// Reads the content of an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Parse<RawMesh> {
    let mut at = Cursor::with_comments(bytes);
    let mut mesh = RawMesh::default();
    while let Some((start, line)) = at.line() {
        // A line may go on after a backslash.
        let mut line = line.to_vec();
        while line.last() == Some(&b'\\') {
            line.pop();
            let next = at.rest_of_line();
            line.push(b' ');
            line.extend_from_slice(next);
        }
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                let mut p = [0.0; 3];
                for (axis, value) in ["x", "y", "z"].iter().zip(&mut p) {
                    let word = words.next().unwrap_or_default();
                    *value = crate::io::cursor::number(word).ok_or_else(|| {
                        at.error_at(
                            start,
                            format_args!(
                                "expected the {axis} of a vertex, found {:?}",
                                String::from_utf8_lossy(&word[..word.len().min(40)])
                            ),
                        )
                    })?;
                }
                mesh.nodes.push(p.into());
            }
            Some(b"f") => {
                let vertices = mesh.nodes.len();
                let mut corners = Vec::new();
                for word in words {
                    let index = word.split(|b| *b == b'/').next().unwrap_or_default();
                    let corner = integer(index).and_then(|i| match i {
                        1.. => usize::try_from(i - 1).ok().filter(|i| *i < vertices),
                        // Counted back from the latest vertex.
                        ..0 => usize::try_from(i.unsigned_abs())
                            .ok()
                            .and_then(|i| vertices.checked_sub(i)),
                        0 => None,
                    });
                    corners.push(corner.ok_or_else(|| {
                        at.error_at(
                            start,
                            format_args!(
                                "a face names vertex {:?}, but there are {vertices} so far, counted from 1",
                                String::from_utf8_lossy(&index[..index.len().min(40)])
                            ),
                        )
                    })?);
                }
                if corners.len() < 3 {
                    return Err(at.error_at(
                        start,
                        format_args!("a face has {} vertices, not three or more", corners.len()),
                    ));
                }
                mesh.cells.push(POLYGON, corners);
            }
            _ => {}
        }
    }
    Ok(mesh)
}
