//! Picking: the skin triangle at a pixel, and the body node that it is bound to.

use super::draw::Skin;
use crate::Result;
use crate::gpu::Texel;
use crate::render::{Camera, PickRay};
use glam::{DVec2, DVec3};

/// Result of picking a skin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinPick {
    /// Triangle index in the surface.
    pub triangle: usize,
    /// Index of its nearest vertex in the surface.
    pub vertex: u32,
    /// Node of the body with the largest weight in that vertex.
    pub node: u32,
    /// Intersection of the ray with the triangle, in file units.
    pub point: DVec3,
    /// Distance of the intersection from the ray origin, in file units.
    pub distance: f64,
}

impl Skin {
    /// Returns the closest intersection of the deformed skin, from either side, with the ray
    /// through the point `pixel` of an image of `size` pixels, or `None` on a miss. Waits and reads
    /// back 36 bytes; meant for the start of a grab.
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
        // Three items a vertex; the first is the position.
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
