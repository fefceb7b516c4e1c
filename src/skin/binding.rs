//! Tying the vertices of a skin to the base triangles of a body, once, in float64.

use super::binder::{Binder, BindingKind, Vertex};
use super::vertices::Vertices;
use crate::mesh::LocalFrame;
use crate::parallel;
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};
use glam::DVec3;

/// How nodes carry vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// Each vertex sits on the nearest surface node and takes its normal (section 3.2).
    OneToOne,
    /// An offset in the basis of the nearest base triangle (equations 4 to 7).
    Constant,
    /// The same in a basis that turns with the normals of the triangle's nodes (equation 8).
    Interpolated,
    /// An offset along the interpolated normal alone (section 3.5).
    NormalOnly,
    /// For each vertex: constant where a node of its triangle has no normal or one turned away,
    /// and where nobody would see a difference; interpolated elsewhere.
    #[default]
    Auto,
}

/// Names of the mappings, as in scenes.
const NAMES: [(&str, Mapping); 5] = [
    ("one-to-one", Mapping::OneToOne),
    ("constant", Mapping::Constant),
    ("interpolated", Mapping::Interpolated),
    ("normal-only", Mapping::NormalOnly),
    ("auto", Mapping::Auto),
];

impl Mapping {
    /// Every mapping.
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
            Error::Input(format!(
                "there is no mapping \"{name}\"; choose from {names}"
            ))
        })
    }
}

impl std::fmt::Display for Mapping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let known = NAMES.iter().find(|(_, m)| m == self);
        f.write_str(known.map_or("?", |(n, _)| n))
    }
}

/// What carries a skin, at rest.
#[derive(Clone, Copy, Debug)]
pub struct BaseMesh<'a> {
    /// Nodes as the GPU has them: in the local frame, rounded to single precision.
    pub nodes: &'a [DVec3],
    /// Base triangles, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Normals of the nodes as the GPU has them, see [`pack_normal`](crate::mesh::pack_normal).
    pub normals: &'a [u32],
}

/// How the vertices of a skin were bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct BindingReport {
    /// Vertices on a node.
    pub one_to_one: usize,
    /// Vertices in the basis of a triangle.
    pub constant: usize,
    /// Vertices in an interpolated basis.
    pub interpolated: usize,
    /// Vertices along an interpolated normal.
    pub normal_only: usize,
    /// Of the constant ones, those for which the mapping asked for is not defined: no normals, a
    /// vanishing sum of them, one along the edge, or none that meets the vertex.
    pub fallbacks: usize,
    /// Base triangles without a plane, to which nothing is bound.
    pub flat_triangles: usize,
    /// The longest offset, in file units.
    pub longest_offset: f64,
}

/// Binds every vertex to the nearest base triangle that has a plane. `frame` is the local frame
/// of the nodes. Time O(v log t), in parallel.
///
/// # Errors
/// [`Error::Input`] when there is no triangle to bind to, one names a node that does not exist,
/// or lists differ in length.
pub fn bind(
    base: &BaseMesh,
    vertices: &Vertices,
    frame: &LocalFrame,
    mapping: Mapping,
) -> Result<(Vec<VertexBinding>, BindingReport)> {
    let binder = Binder::new(base, mapping)?;
    let bound = parallel::map(vertices.positions.len(), |v| {
        binder.bind(&Vertex::new(vertices, v, frame), mapping, &|_| true)
    });
    let mut report = BindingReport {
        flat_triangles: base.triangles.len() - binder.count(),
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

/// Flag of a vertex, see `lib/skin.wgsl`.
const INTERPOLATED: u32 = 1;

/// The texels of all vertices, four each.
pub(super) fn vertex_texels(bound: &[VertexBinding], vertices: &Vertices) -> Vec<[u32; 4]> {
    let all = bound.iter().zip(&vertices.handedness);
    all.flat_map(|(b, handedness)| record(b, *handedness))
        .collect()
}

/// The four texels of a vertex, see `lib/skin.wgsl`.
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
