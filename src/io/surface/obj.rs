//! Reader for Wavefront OBJ: positions, polygons, and the texture coordinates and normals of their
//! corners if every corner has them. Groups and materials are skipped.

use crate::io::cursor::{Cursor, ParseResult, integer, number};
use crate::io::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, NORMAL, UV};

/// VTK number of a triangle.
const TRIANGLE: u8 = 5;

/// A list of corner attributes (texture coordinates or normals), and its values at the triangles.
struct Extra {
    name: &'static str,
    what: &'static str,
    width: usize,
    listed: Vec<f64>,
    corners: Vec<f64>,
    missing: bool,
}

impl Extra {
    fn new(name: &'static str, what: &'static str, width: usize) -> Extra {
        Extra {
            name,
            what,
            width,
            listed: Vec::new(),
            corners: Vec::new(),
            missing: false,
        }
    }

    fn count(&self) -> usize {
        self.listed.len() / self.width
    }

    /// Appends an item to the list; anything but a number counts as 0.
    fn list<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) {
        for _ in 0..self.width {
            let value = words.next().and_then(number).filter(|x| x.is_finite());
            self.listed.push(value.unwrap_or(0.0));
        }
    }

    fn push(&mut self, item: Option<usize>) {
        match item {
            Some(i) => {
                let from = i * self.width;
                self.corners
                    .extend_from_slice(&self.listed[from..from + self.width]);
            }
            None => self.missing = true,
        }
    }

    fn into_field(self, mesh: &mut RawMesh) {
        if self.missing && !self.corners.is_empty() {
            mesh.warnings.push(format!(
                "{} skipped: not defined at every corner",
                self.what
            ));
        } else if !self.missing && !self.corners.is_empty() {
            mesh.fields.push(Field {
                components: 3 * self.width,
                ..Field::scalar(self.name, Location::Cell, self.corners)
            });
        }
    }
}

/// Returns the index referenced by `word` among `count` items so far: from 1, or backwards from the
/// last.
fn item(word: &[u8], count: usize) -> Option<usize> {
    integer(word).and_then(|i| match i {
        1.. => usize::try_from(i - 1).ok().filter(|i| *i < count),
        ..0 => usize::try_from(i.unsigned_abs())
            .ok()
            .and_then(|i| count.checked_sub(i)),
        0 => None,
    })
}

/// Reads the content of an OBJ file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::with_comments(bytes);
    let mut mesh = RawMesh::default();
    let mut uvs = Extra::new(UV, "texture coordinates", 2);
    let mut normals = Extra::new(NORMAL, "normals", 3);
    while let Some((start, line)) = at.line() {
        // A line continues after a backslash.
        let mut line = line.to_vec();
        while line.last() == Some(&b'\\') {
            line.pop();
            let next = at.rest_of_line();
            line.push(b' ');
            line.extend_from_slice(next);
        }
        let shown = |word: &[u8]| String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                let mut p = [0.0; 3];
                for (axis, value) in ["x", "y", "z"].iter().zip(&mut p) {
                    let word = words.next().unwrap_or_default();
                    *value = number(word).ok_or_else(|| {
                        at.error_at(
                            start,
                            format_args!(
                                "expected the {axis} of a vertex, found {:?}",
                                shown(word)
                            ),
                        )
                    })?;
                }
                mesh.nodes.push(p.into());
            }
            Some(b"vt") => uvs.list(words),
            Some(b"vn") => normals.list(words),
            Some(b"f") => {
                let vertices = mesh.nodes.len();
                let mut corners = Vec::new();
                for word in words {
                    let mut parts = word.split(|b| *b == b'/');
                    let index = parts.next().unwrap_or_default();
                    let vertex = item(index, vertices).ok_or_else(|| {
                        at.error_at(
                            start,
                            format_args!(
                                "face refers to vertex {:?}, but there are {vertices} so far \
                                (counted from 1)",
                                shown(index)
                            ),
                        )
                    })?;
                    let uv = parts.next().and_then(|w| item(w, uvs.count()));
                    let normal = parts.next().and_then(|w| item(w, normals.count()));
                    corners.push((vertex, uv, normal));
                }
                if corners.len() < 3 {
                    return Err(at.error_at(
                        start,
                        format_args!("face must have at least 3 vertices, got {}", corners.len()),
                    ));
                }
                for pair in corners[1..].windows(2) {
                    let fan = [corners[0], pair[0], pair[1]];
                    mesh.cells.push(TRIANGLE, fan.map(|c| c.0));
                    fan.iter().for_each(|c| uvs.push(c.1));
                    fan.iter().for_each(|c| normals.push(c.2));
                }
            }
            _ => {}
        }
    }
    uvs.into_field(&mut mesh);
    normals.into_field(&mut mesh);
    Ok(mesh)
}
