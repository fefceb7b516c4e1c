//! Vertices of a surface prepared for drawing: one for each distinct triangle corner.

use crate::mesh::TriMesh;
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Vertices of a surface prepared for drawing. A vertex is split where texture coordinates or given
/// normals differ between its triangles (a seam or a crease).
#[derive(Clone, Debug, Default)]
pub struct Vertices {
    /// Positions, in file units.
    pub positions: Vec<DVec3>,
    /// Unit normals: from the file, or the angle-weighted mean of the incident triangles' normals.
    pub normals: Vec<DVec3>,
    /// Unit tangents orthogonal to the normal, in the direction of increasing first texture
    /// coordinate; arbitrary without texture coordinates.
    pub tangents: Vec<DVec3>,
    /// 1, or −1 where the texture is mirrored: the second coordinate increases along handedness ·
    /// normal × tangent.
    pub handedness: Vec<f64>,
    /// Texture coordinates; empty where the surface has none.
    pub uvs: Vec<DVec2>,
    /// Index of the surface's vertex for each of these.
    pub sources: Vec<u32>,
    /// Three vertex indices a triangle, in the order of the surface.
    pub triangles: Vec<[u32; 3]>,
}

impl Vertices {
    /// Creates the vertices of `surface`.
    ///
    /// # Errors
    /// [`Error::Mesh`] if there are no triangles, one refers to a vertex that does not exist, or a
    /// vertex is not finite.
    pub fn new(surface: &TriMesh) -> Result<Vertices> {
        check(surface)?;
        let uvs = surface.corner_uvs();
        let given = surface.corner_normals();
        let smooth = angle_weighted(surface);
        let mut vertices = Vertices::default();
        let mut known: HashMap<(u32, [u64; 6]), u32> = HashMap::new();
        for (t, triangle) in surface.triangles.iter().enumerate() {
            let uv = uvs.as_ref().map(|u| u[t]);
            let mirrored = uv.is_some_and(|[a, b, c]| (b - a).perp_dot(c - a) < 0.0);
            let corners = [0, 1, 2].map(|k| {
                let source = triangle[k];
                let own = given.as_ref().and_then(|n| n[t][k].try_normalize());
                let uv = uv.map(|u| u[k]).unwrap_or_default();
                let n = own.unwrap_or(DVec3::ZERO);
                let bits = [n.x, n.y, n.z, uv.x, uv.y].map(f64::to_bits);
                let [x, y, z, u, v] = bits;
                let key = (source, [x, y, z, u, v, u64::from(mirrored)]);
                *known.entry(key).or_insert_with(|| {
                    vertices.positions.push(surface.vertices[source as usize]);
                    let normal = own.unwrap_or(smooth[source as usize]);
                    vertices.normals.push(normal);
                    vertices.handedness.push(if mirrored { -1.0 } else { 1.0 });
                    if uvs.is_some() {
                        vertices.uvs.push(uv);
                    }
                    vertices.sources.push(source);
                    vertices.sources.len() as u32 - 1
                })
            });
            vertices.triangles.push(corners);
        }
        vertices.tangents = vertices.find_tangents(surface.vertices.len());
        Ok(vertices)
    }

    /// Computes tangents along the first texture coordinate, summed over the incident triangles
    /// with the same texture handedness.
    fn find_tangents(&self, sources: usize) -> Vec<DVec3> {
        let mut sums = vec![[DVec3::ZERO; 2]; sources];
        let side = |v: u32| usize::from(self.handedness[v as usize] < 0.0);
        for triangle in self.triangles.iter().filter(|_| !self.uvs.is_empty()) {
            let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
            let [s, t, u] = triangle.map(|v| self.uvs[v as usize]);
            let along = (b - a) * (u - s).y - (c - a) * (t - s).y;
            let along = along * (t - s).perp_dot(u - s).signum();
            for v in triangle {
                sums[self.sources[*v as usize] as usize][side(*v)] += along;
            }
        }
        (0..self.positions.len())
            .map(|v| {
                let normal = self.normals[v];
                let sum = sums[self.sources[v] as usize][side(v as u32)];
                (sum - normal * normal.dot(sum))
                    .try_normalize()
                    .unwrap_or_else(|| normal.any_orthonormal_vector())
            })
            .collect()
    }
}

/// Returns an error if `surface` is not valid as a skin.
pub(super) fn check(surface: &TriMesh) -> Result<()> {
    let count = surface.vertices.len();
    if surface.triangles.is_empty() {
        return Err(Error::Mesh(
            "the skin has no triangles; a skin needs at least one".into(),
        ));
    }
    let all = || surface.triangles.iter().flatten();
    if let Some(bad) = all().find(|v| **v as usize >= count) {
        return Err(Error::Mesh(format!(
            "vertex index {bad} of a skin triangle is out of range: there are {count} vertices, counted from 0"
        )));
    }
    if let Some(bad) = all().find(|v| !surface.vertices[**v as usize].is_finite()) {
        return Err(Error::Mesh(format!(
            "vertex {bad} of the skin must have finite coordinates, got {}",
            surface.vertices[*bad as usize]
        )));
    }
    Ok(())
}

/// Computes angle-weighted vertex normals; the z axis for vertices without one.
fn angle_weighted(surface: &TriMesh) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; surface.vertices.len()];
    for (t, triangle) in surface.triangles.iter().enumerate() {
        let corners = surface.corners(t);
        let normal = surface.area_vector(t).normalize_or_zero();
        for k in 0..3 {
            let [a, b, c] = [0, 1, 2].map(|i| corners[(k + i) % 3]);
            let (ab, ac) = ((b - a).normalize_or_zero(), (c - a).normalize_or_zero());
            sums[triangle[k] as usize] += ab.dot(ac).clamp(-1.0, 1.0).acos() * normal;
        }
    }
    sums.into_iter().map(|n| n.normalize_or(DVec3::Z)).collect()
}
