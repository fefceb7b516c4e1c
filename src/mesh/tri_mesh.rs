//! Triangle meshes as stored in files.

use super::{AnatomicalFrame, Field, Location};
use glam::{DVec2, DVec3};

/// Name of the field of texture coordinates: two numbers per vertex, or six per triangle, two for
/// each corner, which may differ between the triangles at a vertex (a seam).
pub(crate) const UV: &str = "uv";
/// Name of the field of normals: three numbers per vertex, or nine per triangle, three for each
/// corner.
pub(crate) const NORMAL: &str = "normal";

/// A triangle mesh with fields, in the units of the file it came from.
///
/// Triangles are counter-clockwise seen from outside. Values of fields at [`Node`](super::Location)
/// belong to vertices, those in cells to triangles.
#[derive(Clone, Debug, Default)]
pub struct TriMesh {
    /// Vertex positions.
    pub vertices: Vec<DVec3>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Fields at the vertices and in the triangles, by name.
    pub fields: Vec<Field>,
    /// Frame of reference of the coordinates, if known; readers convert LPS to RAS.
    pub frame: Option<AnatomicalFrame>,
    /// Repairs, drops and warnings of the reader, one sentence each.
    pub notes: Vec<String>,
}

impl TriMesh {
    /// Returns the field `name` with `width` numbers per vertex or three times as many per
    /// triangle.
    fn corner_field(&self, name: &str, width: usize) -> Option<&Field> {
        self.fields.iter().find(|f| {
            let items = match f.location {
                Location::Node => self.vertices.len(),
                Location::Cell => 3 * self.triangles.len(),
            };
            let components = match f.location {
                Location::Node => width,
                Location::Cell => 3 * width,
            };
            f.name.eq_ignore_ascii_case(name)
                && f.components == components
                && f.values.len() == items * width
        })
    }

    /// Returns the values of such a field at the corners of triangle `t`.
    fn corner_values(&self, field: &Field, width: usize, t: usize) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|corner| {
            let item = match field.location {
                Location::Node => self.triangles[t][corner] as usize,
                Location::Cell => 3 * t + corner,
            };
            let mut values = [0.0; 3];
            values[..width].copy_from_slice(&field.values[width * item..width * (item + 1)]);
            values
        })
    }

    /// Returns the scalar vertex field of that name, if there is one.
    pub fn vertex_scalar(&self, name: &str) -> Option<&[f64]> {
        self.fields
            .iter()
            .find(|f| f.name == name && f.location == Location::Node && f.components == 1)
            .map(|f| f.values.as_slice())
            .filter(|v| v.len() == self.vertices.len())
    }

    /// Combines several vertex scalars, as in PLY, into tuples.
    fn zip_scalars<const N: usize>(&self, names: [&str; N]) -> Option<Vec<[[f64; N]; 3]>> {
        let found = names.map(|n| self.vertex_scalar(n));
        if found.iter().any(Option::is_none) {
            return None;
        }
        let at = |v: u32| found.map(|f| f.map_or(0.0, |f| f[v as usize]));
        Some(self.triangles.iter().map(|t| t.map(at)).collect())
    }

    /// Returns the texture coordinates of the corners of every triangle: the field `uv`, or the
    /// vertex scalars `u` and `v`, or `s` and `t`.
    pub fn corner_uvs(&self) -> Option<Vec<[DVec2; 3]>> {
        if let Some(field) = self.corner_field(UV, 2) {
            let of = |t| {
                self.corner_values(field, 2, t)
                    .map(|c| DVec2::new(c[0], c[1]))
            };
            return Some((0..self.triangles.len()).map(of).collect());
        }
        let pairs = [["u", "v"], ["s", "t"]];
        let beside = pairs
            .into_iter()
            .find_map(|names| self.zip_scalars(names))?;
        Some(beside.into_iter().map(|c| c.map(DVec2::from)).collect())
    }

    /// Returns the normals of the corners of every triangle from the file: the field `normal` (or
    /// VTK's `Normals`), or the vertex scalars `nx`, `ny` and `nz`.
    pub fn corner_normals(&self) -> Option<Vec<[DVec3; 3]>> {
        let named = [NORMAL, "Normals"];
        if let Some(field) = named.into_iter().find_map(|n| self.corner_field(n, 3)) {
            let of = |t| self.corner_values(field, 3, t).map(DVec3::from);
            return Some((0..self.triangles.len()).map(of).collect());
        }
        let beside = self.zip_scalars(["nx", "ny", "nz"])?;
        Some(beside.into_iter().map(|c| c.map(DVec3::from)).collect())
    }

    /// Flips triangle `t` together with the values of its corners.
    pub(super) fn flip_triangle(&mut self, t: usize) {
        self.triangles[t].swap(1, 2);
        for name in [UV, NORMAL] {
            for field in &mut self.fields {
                let width = field.components / 3;
                if field.name == name && field.location == Location::Cell {
                    let own = &mut field.values[3 * width * t..3 * width * (t + 1)];
                    let (second, third) = own[width..].split_at_mut(width);
                    second.swap_with_slice(third);
                }
            }
        }
    }
}
