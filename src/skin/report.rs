//! What a skin is, and how it was bound.

use super::binding::BindingReport;
use crate::mesh::SurfaceDescription;

/// What a skin is, what was found wrong with its surface, and how it was bound.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SkinReport {
    /// Vertices of the surface.
    pub vertices: usize,
    /// Vertices as they are drawn: more where texture coordinates or normals have seams.
    pub drawn_vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Triangles that were turned to face the way their neighbours do.
    #[serde(rename = "turned")]
    pub flipped_triangles: usize,
    /// Edges of one triangle only: the rims of holes.
    pub open_edges: usize,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: usize,
    /// How the vertices were bound.
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

    /// What a user should know, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let mut note = |count: usize, text: &str| {
            if count > 0 {
                notes.push(format!("{count} {text}"));
            }
        };
        note(
            self.flipped_triangles,
            "triangles were turned to face outward",
        );
        note(self.open_edges, "edges are open: the skin has holes");
        note(
            self.nonmanifold_edges,
            "edges belong to more than two triangles",
        );
        let b = &self.binding;
        note(b.one_to_one, "vertices sit on a node");
        note(b.constant, "vertices have the basis of their triangle");
        note(b.interpolated, "vertices have an interpolated basis");
        note(b.normal_only, "vertices lie along an interpolated normal");
        note(
            b.fallbacks,
            "vertices have the basis of their triangle because the mapping asked for is not defined there",
        );
        note(
            b.flat_triangles,
            "base triangles have no plane; nothing is bound to them",
        );
        notes
    }
}
