//! Normal map baking: transfers the normals of a fine surface to a texture of a coarse one.

use super::map::Map;
use super::vertices::{Vertices, check};
use crate::mesh::{TriMesh, TriangleBvh};
use crate::parallel;
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// Statistics of a [`bake`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct BakeReport {
    /// Texels covered by the coarse surface.
    pub covered: usize,
    /// Covered texels whose normal ray misses the fine surface within the search distance; they use
    /// the normal at its closest point.
    pub missed: usize,
    /// Triangles of the coarse surface with zero area in texture space.
    pub unmapped: usize,
}

/// Search distance for the fine surface, as a fraction of the coarse surface's size.
const REACH: f64 = 0.1;
/// Number of texels by which the texture islands are dilated, for smooth filtering at their
/// borders.
const MARGIN: usize = 4;
/// Texture coordinates with a larger absolute value are rejected as invalid.
const FARTHEST_UV: f64 = 64.0;
/// Texel of a normal map that leaves the normal unchanged.
const FLAT: [u8; 4] = [128, 128, 255, 255];

/// Bakes a tangent-space normal map of `size` texels that makes `coarse`, which needs texture
/// coordinates, look like `fine`: casts a ray from the point of each texel along the interpolated
/// normal, in both directions, and expresses the normal of the fine surface at the hit in the local
/// tangent, bitangent and normal.
///
/// Both surfaces use the same coordinates and unit. Time O(texels · log of the fine triangles), in
/// parallel.
///
/// # Errors
/// [`Error::Input`] if `coarse` has no texture coordinates or has invalid ones, or if the size is
/// not from 1 to 8192; [`Error::Mesh`] for surfaces without triangles.
pub fn bake(coarse: &TriMesh, fine: &TriMesh, size: [u32; 2]) -> Result<(Map, BakeReport)> {
    if size.iter().any(|n| !(1..=8192).contains(n)) {
        return Err(Error::Input(format!(
            "normal map size must be 1 to 8192 texels per side, got {} x {}",
            size[0], size[1]
        )));
    }
    let oriented = |surface: &TriMesh| {
        check(surface)?;
        let mut surface = surface.clone();
        surface.orient_consistently();
        Vertices::new(&surface)
    };
    let (coarse, fine) = (oriented(coarse)?, oriented(fine)?);
    if coarse.uvs.is_empty() {
        return Err(Error::Input(
            "the coarse surface has no texture coordinates, which baking needs; use an OBJ file with texture coordinates"
                .into(),
        ));
    }
    let far = |uv: &&DVec2| !uv.is_finite() || uv.abs().max_element() > FARTHEST_UV;
    if let Some(uv) = coarse.uvs.iter().find(far) {
        return Err(Error::Input(format!(
            "texture coordinates of the coarse surface must be finite and at most {FARTHEST_UV} in magnitude, got {uv}"
        )));
    }
    let (owners, unmapped) = covered(&coarse, size);
    let fine = Fine::new(&fine);
    let (low, high) = crate::mesh::bounds(&coarse.positions);
    let reach = REACH * (high - low).max_element();
    let found = parallel::map(owners.len(), |i| {
        owners[i].map(|(t, w)| fine.normal_at(&coarse, t, w, reach))
    });
    let mut report = BakeReport {
        unmapped,
        ..BakeReport::default()
    };
    for (_, direct_hit) in found.iter().flatten() {
        report.covered += 1;
        report.missed += usize::from(!direct_hit);
    }
    let encode = |n: DVec3| {
        let [x, y, z] = (n * 127.0 + 128.0).round().to_array();
        [x as u8, y as u8, z as u8, 255]
    };
    let texels = found.into_iter().map(|f| f.map(|(n, _)| encode(n)));
    Ok((
        Map {
            size,
            texels: filled(texels.collect(), size),
        },
        report,
    ))
}

/// Rasterises the coarse triangles in texture space. Returns for each texel centre the triangle
/// that covers it with the barycentric weights, and the number of triangles with zero texture area.
#[allow(clippy::type_complexity)]
fn covered(coarse: &Vertices, size: [u32; 2]) -> (Vec<Option<(usize, [f64; 3])>>, usize) {
    let scale = DVec2::new(f64::from(size[0]), f64::from(size[1]));
    let mut owners = vec![None; size[0] as usize * size[1] as usize];
    let mut unmapped = 0;
    for (t, triangle) in coarse.triangles.iter().enumerate() {
        // In texels, relative to the centre of the upper left texel.
        let [a, b, c] = triangle.map(|v| {
            let uv = coarse.uvs[v as usize];
            DVec2::new(uv.x, 1.0 - uv.y) * scale - 0.5
        });
        let area = (b - a).perp_dot(c - a);
        if area.abs() < 1e-12 {
            unmapped += 1;
            continue;
        }
        let (low, high) = (a.min(b).min(c).ceil(), a.max(b).max(c).floor());
        for y in low.y as i64..=high.y as i64 {
            for x in low.x as i64..=high.x as i64 {
                let p = DVec2::new(x as f64, y as f64);
                let w = [(b, c), (c, a), (a, b)].map(|(q, r)| (q - p).perp_dot(r - p) / area);
                if w.iter().all(|w| *w >= -1e-9) {
                    let column = x.rem_euclid(size[0].into()) as usize;
                    let row = y.rem_euclid(size[1].into()) as usize;
                    owners[row * size[0] as usize + column] = Some((t, w));
                }
            }
        }
    }
    (owners, unmapped)
}

/// Dilates the covered texels into the gaps; the remaining texels become flat.
fn filled(mut texels: Vec<Option<[u8; 4]>>, [width, height]: [u32; 2]) -> Vec<[u8; 4]> {
    let (width, height) = (width as usize, height as usize);
    for _ in 0..MARGIN {
        let before = texels.clone();
        for (i, texel) in texels.iter_mut().enumerate().filter(|(_, t)| t.is_none()) {
            let (x, y) = (i % width, i / width);
            let beside = [
                y * width + (x + 1) % width,
                y * width + (x + width - 1) % width,
                (y + 1) % height * width + x,
                (y + height - 1) % height * width + x,
            ];
            *texel = beside.iter().find_map(|j| before[*j]);
        }
    }
    texels.into_iter().map(|t| t.unwrap_or(FLAT)).collect()
}

/// The fine surface with a search tree.
struct Fine<'a> {
    vertices: &'a Vertices,
    tree: TriangleBvh,
}

impl<'a> Fine<'a> {
    fn new(vertices: &'a Vertices) -> Fine<'a> {
        let corners = |t: &[u32; 3]| t.map(|v| vertices.positions[v as usize]);
        Fine {
            tree: TriangleBvh::new(vertices.triangles.iter().map(corners).collect()),
            vertices,
        }
    }

    /// Returns the normal of the fine surface in the tangent space of triangle `t` of `coarse` at
    /// the barycentric weights `w`, and whether the normal ray hits the fine surface.
    fn normal_at(&self, coarse: &Vertices, t: usize, w: [f64; 3], reach: f64) -> (DVec3, bool) {
        let triangle = coarse.triangles[t];
        let mix =
            |list: &[DVec3]| -> DVec3 { (0..3).map(|k| w[k] * list[triangle[k] as usize]).sum() };
        let point = mix(&coarse.positions);
        let normal = mix(&coarse.normals).normalize_or(DVec3::Z);
        let tangent = mix(&coarse.tangents);
        let tangent = (tangent - normal * normal.dot(tangent))
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        let other = coarse.handedness[triangle[0] as usize] * normal.cross(tangent);
        let direct_hit = self.closest_hit(point, normal, reach);
        let hit = direct_hit.or_else(|| self.tree.nearest(point));
        let fine = hit.map_or(normal, |(t, w)| {
            let corners = self.vertices.triangles[t];
            (0..3)
                .map(|k| w[k] * self.vertices.normals[corners[k] as usize])
                .sum::<DVec3>()
                .normalize_or(normal)
        });
        let local = DVec3::new(fine.dot(tangent), fine.dot(other), fine.dot(normal));
        // A tangent-space normal map cannot represent normals that point backwards.
        let local = local.with_z(local.z.max(0.0)).normalize_or(DVec3::Z);
        (local, direct_hit.is_some())
    }

    /// Returns the triangle hit closest to `origin` along ±`direction` whose normal agrees with the
    /// direction, and the barycentric weights of the hit.
    fn closest_hit(
        &self,
        origin: DVec3,
        direction: DVec3,
        reach: f64,
    ) -> Option<(usize, [f64; 3])> {
        let mut best: Option<(f64, usize, [f64; 3])> = None;
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let Some(node) = self.tree.boxes.get(index) else {
                continue;
            };
            let nearest = best.map_or(reach, |b| b.0);
            if !crosses(node.low, node.high, origin, direction, nearest) {
                continue;
            }
            if node.right != 0 {
                stack.extend([node.right, index + 1]);
                continue;
            }
            for i in node.range.0..node.range.1 {
                let Some((along, w)) = intersect_line(self.tree.triangles[i], origin, direction)
                else {
                    continue;
                };
                if along.abs() <= best.map_or(reach, |b| b.0) {
                    best = Some((along.abs(), self.tree.numbers[i] as usize, w));
                }
            }
        }
        best.map(|(_, t, w)| (t, w))
    }
}

/// Whether the line through `origin` intersects the box at a distance of at most `reach`, in either
/// direction.
fn crosses(low: DVec3, high: DVec3, origin: DVec3, direction: DVec3, reach: f64) -> bool {
    let (mut from, mut to) = (-reach, reach);
    for k in 0..3 {
        let (a, b) = (low[k] - origin[k], high[k] - origin[k]);
        if direction[k].abs() < 1e-300 {
            if a > 0.0 || b < 0.0 {
                return false;
            }
            continue;
        }
        let (a, b) = (a / direction[k], b / direction[k]);
        (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
    }
    from <= to + 1e-12 * reach
}

/// Intersects the line with a triangle whose normal agrees with the direction (Möller & Trumbore).
/// Returns the line parameter and the barycentric weights.
fn intersect_line(
    [a, b, c]: [DVec3; 3],
    origin: DVec3,
    direction: DVec3,
) -> Option<(f64, [f64; 3])> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let facing = ab.dot(across);
    // Twice the area times the normal's component against the line.
    if facing.is_nan() || facing >= 0.0 {
        return None;
    }
    let from = origin - a;
    let v = from.dot(across) / facing;
    let turned = from.cross(ab);
    let w = direction.dot(turned) / facing;
    let inside = v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9;
    inside.then(|| (ac.dot(turned) / facing, [1.0 - v - w, v, w]))
}
