//! Reader for Wavefront OBJ: positions, polygons, and the texture coordinates and normals of their
//! corners if every corner has them. Groups and materials are skipped.

use super::polygon::PolygonCutter;
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
        match item.filter(|i| *i < self.count()) {
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

/// Returns the index that `word` refers to: from 1, or backwards from the last of `count` items so
/// far. The first kind may refer to a later item.
fn item(word: &[u8], count: usize) -> Option<usize> {
    integer(word).and_then(|i| match i {
        1.. => usize::try_from(i - 1).ok(),
        ..0 => usize::try_from(i.unsigned_abs())
            .ok()
            .and_then(|i| count.checked_sub(i)),
        0 => None,
    })
}

/// A corner of a face: vertex, texture coordinates, normal.
type Corner = (usize, Option<usize>, Option<usize>);

/// The faces of a file. Their corners are looked up at its end, since a face may come before its
/// vertices.
#[derive(Default)]
struct Faces {
    corners: Vec<Corner>,
    /// The end of each face in `corners`, and its position in the file.
    ends: Vec<(usize, usize)>,
    /// Number of faces of fewer than three vertices.
    skipped: usize,
}

impl Faces {
    /// Adds the face of a line at `start`.
    fn add<'a>(
        &mut self,
        words: impl Iterator<Item = &'a [u8]>,
        counts: [usize; 3],
        (at, start): (&Cursor, usize),
    ) -> ParseResult<()> {
        let first = self.corners.len();
        for word in words {
            let mut parts = word.split(|b| *b == b'/');
            let index = parts.next().unwrap_or_default();
            let vertex = item(index, counts[0])
                .ok_or_else(|| out_of_range(at, start, &shown(index), counts[0]))?;
            let uv = parts.next().and_then(|w| item(w, counts[1]));
            let normal = parts.next().and_then(|w| item(w, counts[2]));
            self.corners.push((vertex, uv, normal));
        }
        if self.corners.len() < first + 3 {
            self.corners.truncate(first);
            self.skipped += 1;
        } else {
            self.ends.push((self.corners.len(), start));
        }
        Ok(())
    }

    /// Adds the triangles of all faces to `mesh`.
    fn triangulate(
        self,
        at: &Cursor,
        mesh: &mut RawMesh,
        extras: &mut [Extra; 2],
    ) -> ParseResult<()> {
        let mut cutter = PolygonCutter::new();
        let mut places = Vec::new();
        let mut first = 0;
        for (end, start) in self.ends {
            let corners = &self.corners[first..end];
            first = end;
            places.clear();
            for corner in corners {
                places.push(*mesh.nodes.get(corner.0).ok_or_else(|| {
                    let index = (corner.0 as u64 + 1).to_string();
                    out_of_range(at, start, &index, mesh.nodes.len())
                })?);
            }
            for triangle in cutter.triangles(&places) {
                let triangle = triangle.map(|n| corners[n]);
                mesh.cells.push(TRIANGLE, triangle.map(|c| c.0));
                triangle.iter().for_each(|c| extras[0].push(c.1));
                triangle.iter().for_each(|c| extras[1].push(c.2));
            }
        }
        if self.skipped > 0 {
            mesh.warnings.push(format!(
                "{} faces of fewer than three vertices skipped",
                self.skipped
            ));
        }
        Ok(())
    }
}

fn out_of_range(at: &Cursor, start: usize, index: &str, vertices: usize) -> String {
    at.error_at(
        start,
        format_args!("face refers to vertex {index:?}, but there are {vertices} (counted from 1)"),
    )
}

/// Returns the start of a word for a message.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned()
}

/// Reads the content of an OBJ file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut at = Cursor::with_comments(bytes);
    let mut mesh = RawMesh::default();
    let mut extras = [
        Extra::new(UV, "texture coordinates", 2),
        Extra::new(NORMAL, "normals", 3),
    ];
    let mut faces = Faces::default();
    while let Some((start, line)) = at.line() {
        // A line continues after a backslash.
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
            Some(b"vt") => extras[0].list(words),
            Some(b"vn") => extras[1].list(words),
            Some(b"f") => {
                let counts = [mesh.nodes.len(), extras[0].count(), extras[1].count()];
                faces.add(words, counts, (&at, start))?;
            }
            _ => {}
        }
    }
    faces.triangulate(&at, &mut mesh, &mut extras)?;
    for extra in extras {
        extra.into_field(&mut mesh);
    }
    Ok(mesh)
}
