//! Picking: from a pixel to what is seen there of a skin, and to the node that carries it.

use super::draw::Skin;
use crate::Result;
use crate::gpu::Texel;
use crate::render::{Camera, PickRay};
use glam::{DVec2, DVec3};

/// What a pixel shows of a skin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinPick {
    /// The triangle, as numbered in the surface.
    pub triangle: usize,
    /// The nearest of its vertices, as numbered in the surface.
    pub vertex: u32,
    /// The node of the body that has the largest share in where that vertex is.
    pub node: u32,
    /// Where the ray meets the triangle, in file units.
    pub point: DVec3,
    /// How far along the ray that is from its origin, in file units.
    pub distance: f64,
}

impl Skin {
    /// What is seen of the skin at the point `pixel` of a picture of `size` pixels, where its
    /// nodes have carried it: the triangle that the ray through it meets first, from either
    /// side; none where it misses. Waits and reads 36 bytes back, for the start of a grab.
    ///
    /// # Errors
    /// As [`Geometry::pick`](crate::render::Geometry::pick).
    pub fn pick(&self, camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<Option<SkinPick>> {
        let shown: Vec<usize> = (0..self.visible.len())
            .filter(|t| self.visible[*t])
            .collect();
        let corners = shown.iter().map(|t| {
            let [a, b, c] = self.vertices.triangles[*t];
            [a, b, c, 0]
        });
        let corners: Vec<[u32; 4]> = corners.collect();
        let corners = self.gpu.array_of("triangles", Texel::U32x4, &corners)?;
        let look = PickRay {
            camera,
            pixel,
            size,
            frame: &self.carrier.frame,
        };
        // Three items a vertex, its position first.
        let hit = look.first_hit(&self.gpu, &self.placed_array()?, 3, &corners)?;
        Ok(hit.and_then(|hit| {
            let triangle = *shown.get(hit.triangle as usize)?;
            let vertex = self.vertices.triangles[triangle][hit.corner] as usize;
            let bound = &self.bound[vertex];
            let share = |k: &usize| bound.weights[*k];
            let most = (0..3).max_by(|i, j| share(i).total_cmp(&share(j)))?;
            Some(SkinPick {
                triangle,
                vertex: self.vertices.sources[vertex],
                node: bound.nodes[most],
                point: hit.point,
                distance: hit.distance,
            })
        }))
    }
}
