//! Binding of skin vertices to the base triangles of a body, once, in float64.

use super::binder::{Binder, BindingKind, Vertex};
use super::vertices::Vertices;
use crate::mesh::LocalFrame;
use crate::parallel;
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};
use glam::DVec3;

/// Mapping from nodes to skin vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// Each vertex takes the position and the normal of the nearest surface node (section 3.2).
    OneToOne,
    /// An offset in the basis of the closest base triangle (equations 4 to 7).
    Constant,
    /// An offset in a basis that follows the node normals of the triangle (equation 8).
    Interpolated,
    /// An offset along the interpolated normal only (section 3.5).
    NormalOnly,
    /// Per vertex: constant where a node of its triangle has no normal or one that points away, and
    /// where the difference is not visible; interpolated elsewhere.
    #[default]
    Auto,
}

/// Mapping names used in scene files.
const NAMES: [(&str, Mapping); 5] = [
    ("one-to-one", Mapping::OneToOne),
    ("constant", Mapping::Constant),
    ("interpolated", Mapping::Interpolated),
    ("normal-only", Mapping::NormalOnly),
    ("auto", Mapping::Auto),
];

impl Mapping {
    /// All mappings.
    pub const ALL: [Mapping; 5] = [
        Mapping::OneToOne,
        Mapping::Constant,
        Mapping::Interpolated,
        Mapping::NormalOnly,
        Mapping::Auto,
    ];
}

impl std::str::FromStr for Mapping {
    type Err = Error;

    fn from_str(name: &str) -> Result<Mapping> {
        let known = NAMES.iter().find(|(n, _)| *n == name);
        known.map(|(_, m)| *m).ok_or_else(|| {
            let names = NAMES.map(|(n, _)| n).join(", ");
            Error::Input(format!("unknown mapping \"{name}\"; available: {names}"))
        })
    }
}

impl std::fmt::Display for Mapping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let known = NAMES.iter().find(|(_, m)| m == self);
        f.write_str(known.map_or("?", |(n, _)| n))
    }
}

/// Rest state of a base mesh.
#[derive(Clone, Copy, Debug)]
pub struct BaseMesh<'a> {
    /// Rest positions as on the GPU: in the local frame, rounded to single precision.
    pub nodes: &'a [DVec3],
    /// Base triangles, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Packed node normals as on the GPU, see [`pack_normal`](crate::mesh::pack_normal).
    pub normals: &'a [u32],
}

/// Statistics of a binding.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct BindingReport {
    /// Vertices bound to a node.
    pub one_to_one: usize,
    /// Vertices bound in the basis of a triangle.
    pub constant: usize,
    /// Vertices bound in an interpolated basis.
    pub interpolated: usize,
    /// Vertices bound along an interpolated normal.
    pub normal_only: usize,
    /// Constant bindings used because the requested mapping is undefined there: no normals, a
    /// vanishing sum of normals, one parallel to the edge, or none that passes through the vertex.
    pub fallbacks: usize,
    /// Degenerate base triangles, to which nothing is bound.
    pub flat_triangles: usize,
    /// Largest offset, in file units.
    pub longest_offset: f64,
}

impl BaseMesh<'_> {
    /// Binds every vertex to the closest non-degenerate base triangle. `frame` is the local frame of
    /// the nodes. Time O(v log t), in parallel.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no triangle to bind to, one refers to a node that does not exist,
    /// or lists differ in length.
    pub fn bind(
        &self,
        vertices: &Vertices,
        frame: &LocalFrame,
        mapping: Mapping,
    ) -> Result<(Vec<VertexBinding>, BindingReport)> {
        let binder = Binder::new(self, mapping)?;
        let bound = parallel::map(vertices.positions.len(), |v| {
            binder.bind(&Vertex::new(vertices, v, frame), mapping, &|_| true)
        });
        let mut report = BindingReport {
            flat_triangles: self.triangles.len() - binder.count(),
            ..BindingReport::default()
        };
        for (bound, kind) in &bound {
            match kind {
                BindingKind::OneToOne => report.one_to_one += 1,
                BindingKind::Constant => report.constant += 1,
                BindingKind::Interpolated => report.interpolated += 1,
                BindingKind::NormalOnly => report.normal_only += 1,
                BindingKind::Fallback => {
                    report.constant += 1;
                    report.fallbacks += 1;
                }
            }
            let offset = bound.offset.length() * frame.scale;
            report.longest_offset = report.longest_offset.max(offset);
        }
        Ok((bound.into_iter().map(|b| b.0).collect(), report))
    }
}

/// Vertex flag, see `lib/skin.wgsl`.
const INTERPOLATED: u32 = 1;

/// Packs all vertices, four texels each.
pub(super) fn vertex_texels(bound: &[VertexBinding], vertices: &Vertices) -> Vec<[u32; 4]> {
    let all = bound.iter().zip(&vertices.handedness);
    all.flat_map(|(b, handedness)| record(b, *handedness))
        .collect()
}

/// Packs a vertex into four texels, see `lib/skin.wgsl`.
fn record(bound: &VertexBinding, handedness: f64) -> [[u32; 4]; 4] {
    let bits = |v: DVec3, w: f64| v.extend(w).as_vec4().to_array().map(f32::to_bits);
    let [a, b, c] = bound.nodes;
    let flags = if bound.interpolated { INTERPOLATED } else { 0 };
    [
        [a, b, c, flags],
        bits(bound.offset, bound.weights[1]),
        bits(bound.normal, bound.weights[2]),
        bits(bound.tangent, handedness),
    ]
}
