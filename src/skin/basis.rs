//! Embedding of vertices in base triangles, in float64: the CPU reference of
//! `shaders/lib/skin.wgsl`.
//!
//! Equations are those of Mosegaard & Sørensen, *Real-time Deformation of Detailed Geometry Based
//! on Mappings to a Less Detailed Physical Simulation on the GPU* (2005). The bases are orthonormal
//! here: the printed N of equation 6 and N_c and B_c of equation 8 are not of length 1, so a vertex
//! would not return to its rest position.

use super::binding::BaseMesh;
use glam::{DMat3, DVec3};

/// Sines, and lengths of sums of unit vectors, below this count as zero.
const DEGENERATE: f64 = 1e-4;

/// Binding of a vertex to its base triangle; vectors are in the basis (T, N, B).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexBinding {
    /// Nodes p₁, p₂ and p₃.
    pub nodes: [u32; 3],
    /// Whether the basis follows the node normals (equation 8) or only the triangle (equation 6).
    pub interpolated: bool,
    /// Weights w₁, w₂ and w₃ of the reference point (equation 4); their sum is 1.
    pub weights: [f64; 3],
    /// Offset from the reference point to the vertex (equation 7).
    pub offset: DVec3,
    /// Vertex normal.
    pub normal: DVec3,
    /// Vertex tangent, the direction in which the first texture coordinate increases.
    pub tangent: DVec3,
}

/// A vertex in the deformed state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinnedVertex {
    /// Position.
    pub position: DVec3,
    /// Normal; of length 1 if it is so at rest.
    pub normal: DVec3,
    /// Tangent.
    pub tangent: DVec3,
}

/// Returns T, N and B of the triangle `p` as columns (equation 6, N normalised), or `None` if it is
/// degenerate: N shorter than 10⁻⁴.
pub(crate) fn triangle_frame([p1, p2, p3]: [DVec3; 3]) -> Option<DMat3> {
    let tangent = (p2 - p1).normalize_or_zero();
    let normal = tangent.cross((p3 - p1).normalize_or_zero());
    let size = normal.length();
    (size > DEGENERATE).then(|| {
        let normal = normal / size;
        DMat3::from_cols(tangent, normal, normal.cross(tangent))
    })
}

/// Returns T_c, N_c and B_c as columns (equation 8, normalised) for the edge direction `tangent`
/// and the weighted sum `normal` of the node normals, or `None` if the sum vanishes or is parallel
/// to the edge.
pub(crate) fn interpolated_frame(tangent: DVec3, normal: DVec3) -> Option<DMat3> {
    let size = normal.length();
    if size.is_nan() || size <= DEGENERATE {
        return None;
    }
    let normal = normal / size;
    let across = normal.cross(tangent);
    let length = across.length();
    (length > DEGENERATE).then(|| {
        let across = across / length;
        DMat3::from_cols(across.cross(normal), normal, across)
    })
}

impl VertexBinding {
    /// Returns the basis of a vertex: the interpolated one if requested and defined, else that of the
    /// triangle, else any with the edge p₁p₂ as T.
    pub fn basis(interpolated: bool, p: [DVec3; 3], normal: DVec3) -> DMat3 {
        let tangent = (p[1] - p[0]).normalize_or_zero();
        let smooth = || interpolated_frame(tangent, normal);
        interpolated
            .then(smooth)
            .flatten()
            .or_else(|| triangle_frame(p))
            .unwrap_or_else(|| {
                let tangent = if tangent == DVec3::ZERO {
                    DVec3::X
                } else {
                    tangent
                };
                let axis = if tangent.x.abs() < 0.7 {
                    DVec3::X
                } else {
                    DVec3::Y
                };
                let normal = tangent.cross(axis).normalize();
                DMat3::from_cols(tangent, normal, normal.cross(tangent))
            })
    }
}

/// Returns Σ wᵢ N_a(i) over the nodes that have a normal (equation 8).
pub(crate) fn interpolated_normal(weights: [f64; 3], normals: [Option<DVec3>; 3]) -> DVec3 {
    (0..3)
        .map(|k| weights[k] * normals[k].unwrap_or(DVec3::ZERO))
        .sum()
}

impl VertexBinding {
    /// Computes the deformed vertex (equation 9). `normals` are the unpacked packed or approximate node
    /// normals; `None` for a node without a normal.
    pub fn skin(&self, nodes: &[DVec3], normals: &[Option<DVec3>]) -> SkinnedVertex {
        let p = self.nodes.map(|i| nodes[i as usize]);
        let n = self.nodes.map(|i| normals[i as usize]);
        let w = self.weights;
        let frame = VertexBinding::basis(self.interpolated, p, interpolated_normal(w, n));
        SkinnedVertex {
            position: w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + frame * self.offset,
            normal: frame * self.normal,
            tangent: frame * self.tangent,
        }
    }
}

impl BaseMesh<'_> {
    /// Computes the area-weighted normal of every node; `None` if the triangle normals cancel or the
    /// node has no triangle. CPU reference of `shaders/skin/node_normals.wgsl`.
    pub fn reference_normals(nodes: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Option<DVec3>> {
        let mut sums = vec![DVec3::ZERO; nodes.len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|v| nodes[v as usize]);
            let area = (b - a).cross(c - a);
            triangle.iter().for_each(|v| sums[*v as usize] += area);
        }
        sums.into_iter().map(DVec3::try_normalize).collect()
    }
}
