//! Vertices carried by the nodes of base triangles, in float64: the twin of
//! `shaders/lib/skin.wgsl`.
//!
//! Equations are those of Mosegaard & Sørensen, *Real-time Deformation of Detailed Geometry Based
//! on Mappings to a Less Detailed Physical Simulation on the GPU* (2005). Bases are orthonormal
//! here: the printed N of equation 6 and N_c and B_c of equation 8 are not of length 1, and a
//! vertex would not return to its place.

use glam::{DMat3, DVec3};

/// Sines and lengths (of unit vectors' sums) below this count as zero.
const DEGENERATE: f64 = 1e-4;

/// What ties a vertex to its base triangle; vectors are along (T, N, B) of its basis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexBinding {
    /// The nodes p₁, p₂ and p₃.
    pub nodes: [u32; 3],
    /// Whether the basis turns with the normals of the nodes (equation 8) or with the triangle
    /// alone (equation 6).
    pub interpolated: bool,
    /// w₁, w₂ and w₃ of the reference point (equation 4); their sum is 1.
    pub weights: [f64; 3],
    /// From the reference point to the vertex (equation 7).
    pub offset: DVec3,
    /// The vertex's normal.
    pub normal: DVec3,
    /// The vertex's tangent, along which the first texture coordinate grows.
    pub tangent: DVec3,
}

/// A vertex where its nodes have carried it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinnedVertex {
    /// Where it is.
    pub position: DVec3,
    /// Its normal, of length 1 if it was so at rest.
    pub normal: DVec3,
    /// Its tangent.
    pub tangent: DVec3,
}

/// T, N and B of the triangle `p` as columns (equation 6, N normalised); none if it is flat: N
/// shorter than 10⁻⁴.
pub fn triangle_frame([p1, p2, p3]: [DVec3; 3]) -> Option<DMat3> {
    let tangent = (p2 - p1).normalize_or_zero();
    let normal = tangent.cross((p3 - p1).normalize_or_zero());
    let size = normal.length();
    (size > DEGENERATE).then(|| {
        let normal = normal / size;
        DMat3::from_cols(tangent, normal, normal.cross(tangent))
    })
}

/// T_c, N_c and B_c as columns (equation 8, normalised) for the edge direction `tangent` and the
/// weighted sum `normal` of the nodes' normals; none where the sum vanishes or lies along the
/// edge.
pub fn interpolated_frame(tangent: DVec3, normal: DVec3) -> Option<DMat3> {
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

/// The basis that carries a vertex: the interpolated one if asked for and defined, else the
/// triangle's, else any that has the edge p₁p₂ as T.
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

/// Σ wᵢ N_a(i) over those nodes that have a normal (equation 8).
pub fn interpolated_normal(weights: [f64; 3], normals: [Option<DVec3>; 3]) -> DVec3 {
    (0..3)
        .map(|k| weights[k] * normals[k].unwrap_or(DVec3::ZERO))
        .sum()
}

/// Where the nodes carry a vertex (equation 9). `normals` are the nodes' packed or approximate
/// normals, unpacked; none where a node has none.
pub fn skin_vertex(
    bound: &VertexBinding,
    nodes: &[DVec3],
    normals: &[Option<DVec3>],
) -> SkinnedVertex {
    let p = bound.nodes.map(|i| nodes[i as usize]);
    let n = bound.nodes.map(|i| normals[i as usize]);
    let w = bound.weights;
    let frame = basis(bound.interpolated, p, interpolated_normal(w, n));
    SkinnedVertex {
        position: w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + frame * bound.offset,
        normal: frame * bound.normal,
        tangent: frame * bound.tangent,
    }
}

/// The normal of every node: the triangles around it summed by area; none where they cancel or
/// there are none. The twin of `shaders/skin/node_normals.wgsl`.
pub fn node_normals(nodes: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Option<DVec3>> {
    let mut sums = vec![DVec3::ZERO; nodes.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| nodes[v as usize]);
        let area = (b - a).cross(c - a);
        triangle.iter().for_each(|v| sums[*v as usize] += area);
    }
    sums.into_iter().map(DVec3::try_normalize).collect()
}
