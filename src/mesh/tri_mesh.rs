//! Triangle meshes: surfaces as files hold them.

use super::Field;
use glam::DVec3;

/// A triangle mesh with fields, in the units of the file it came from.
///
/// Triangles run anticlockwise seen from outside. Values of fields at [`Node`](super::Location)
/// belong to vertices, those in cells to triangles.
#[derive(Clone, Debug, Default)]
pub struct TriMesh {
    /// Vertex positions.
    pub vertices: Vec<DVec3>,
    /// Three vertex indices a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Fields at the vertices and in the triangles, by name.
    pub fields: Vec<Field>,
    /// What was repaired, dropped or noticed when it was read, a sentence each.
    pub notes: Vec<String>,
}
