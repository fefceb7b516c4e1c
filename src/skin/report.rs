//! Statistics of a skin and its binding.

use super::binding::BindingReport;
use crate::mesh::SurfaceDescription;

/// Statistics and defects of a skin's surface, and its binding.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SkinReport {
    /// Vertices of the surface.
    pub vertices: usize,
    /// Drawn vertices: more than `vertices` if texture coordinates or normals have seams.
    pub drawn_vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Triangles flipped to match the orientation of their neighbours.
    #[serde(rename = "turned")]
    pub flipped_triangles: usize,
    /// Edges of only one triangle: borders of holes.
    pub open_edges: usize,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: usize,
    /// Statistics of the binding.
    pub binding: BindingReport,
}

impl SkinReport {
    pub(super) fn new(
        surface: &SurfaceDescription,
        drawn_vertices: usize,
        flipped_triangles: usize,
        binding: BindingReport,
    ) -> SkinReport {
        SkinReport {
            vertices: surface.vertices,
            drawn_vertices,
            triangles: surface.triangles,
            flipped_triangles,
            open_edges: surface.open_edges,
            nonmanifold_edges: surface.nonmanifold_edges,
            binding,
        }
    }

    /// Returns notes for the user, one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let mut note = |count: usize, text: &str| {
            if count > 0 {
                notes.push(format!("{count} {text}"));
            }
        };
        note(
            self.flipped_triangles,
            "triangles were flipped to face outwards",
        );
        note(self.open_edges, "open edges: the skin has holes");
        note(
            self.nonmanifold_edges,
            "edges are shared by more than two triangles",
        );
        let b = &self.binding;
        note(b.one_to_one, "vertices coincide with a node (one-to-one)");
        note(
            b.constant,
            "vertices use the constant basis of their triangle",
        );
        note(b.interpolated, "vertices use an interpolated basis");
        note(
            b.normal_only,
            "vertices are bound along an interpolated normal (normal-only)",
        );
        note(
            b.fallbacks,
            "vertices use the constant basis of their triangle because the requested mapping is undefined there",
        );
        note(
            b.flat_triangles,
            "base triangles are degenerate; no vertex is bound to them",
        );
        notes
    }
}
