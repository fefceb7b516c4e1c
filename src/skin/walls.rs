//! Skins for light paths: their triangles in the deformed state.

use super::draw::Skin;
use crate::Result;
use crate::render::{Wall, linear_light};
use glam::Vec3;

impl Skin {
    /// Returns the drawn triangles in the deformed state, in the local frame, with the colours of
    /// their vertices; normal and height maps are left out. Waits and reads back.
    ///
    /// # Errors
    /// An error if the device fails.
    pub(crate) fn walls(&self) -> Result<Vec<Wall>> {
        let placed: Vec<[f32; 4]> = self.gpu.read_array(&self.placed_array()?)?;
        let colours: Vec<[f32; 4]> = self.gpu.read_array(&self.colours)?;
        let drawn: Vec<u32> = self.gpu.read_buffer(&self.indices)?;
        let vector = |texels: &[[f32; 4]], k: usize| {
            let [x, y, z, _] = texels[k];
            Vec3::new(x, y, z)
        };
        let triangles = drawn[..self.corners as usize].chunks_exact(3);
        let wall = |triangle: &[u32]| {
            let each = |of: &dyn Fn(usize) -> Vec3| {
                std::array::from_fn(|corner| of(triangle[corner] as usize))
            };
            Wall {
                corners: each(&|v| vector(&placed, 3 * v)),
                normals: each(&|v| vector(&placed, 3 * v + 1)),
                colours: each(&|v| linear_light(vector(&colours, v))),
                opacity: self.opacity,
            }
        };
        Ok(triangles.map(wall).collect())
    }
}
