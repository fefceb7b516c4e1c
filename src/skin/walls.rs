//! Skins for light paths: their triangles in the deformed state.

use super::draw::Skin;
use crate::Result;
use crate::gpu::PendingReadback;
use crate::render::{Wall, linear_light};
use glam::Vec3;

/// Triangles of a skin that are being read back.
pub(crate) struct PendingWalls {
    triangles: Vec<[u32; 3]>,
    opacity: f32,
    /// Vertices in the deformed state, three items each, and their colours: on the way, and arrived.
    pending: [PendingReadback<[f32; 4]>; 2],
    arrived: [Option<Vec<[f32; 4]>>; 2],
}

impl Skin {
    /// Starts to read back the drawn triangles in the deformed state, in the local frame, with the
    /// colours of their vertices; normal and height maps are left out.
    ///
    /// # Errors
    /// An error if the device fails.
    pub(crate) fn walls(&self) -> Result<PendingWalls> {
        let placed = self.gpu.read_array_async(&self.placed_array()?)?;
        let colours = self.gpu.read_array_async(&self.colours)?;
        Ok(PendingWalls {
            triangles: self.shown_triangles(),
            opacity: self.opacity,
            pending: [placed, colours],
            arrived: [None, None],
        })
    }
}

impl PendingWalls {
    /// Returns the triangles if they have arrived. Does not block.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn try_take(&mut self) -> Result<Option<Vec<Wall>>> {
        for (pending, arrived) in self.pending.iter_mut().zip(&mut self.arrived) {
            if arrived.is_none() {
                *arrived = pending.try_take()?;
            }
        }
        match &self.arrived {
            [Some(placed), Some(colours)] => Ok(Some(walls_of(
                (&self.triangles, self.opacity),
                placed,
                colours,
            ))),
            _ => Ok(None),
        }
    }

    /// Waits for the triangles, none of which was taken, and returns them.
    ///
    /// # Errors
    /// An error if the device fails; in a browser, which cannot wait.
    pub fn wait(self) -> Result<Vec<Wall>> {
        let [placed, colours] = self.pending;
        let [placed, colours] = [placed.wait()?, colours.wait()?];
        Ok(walls_of((&self.triangles, self.opacity), &placed, &colours))
    }
}

/// Returns the triangles, of one opacity, given three items per vertex, and its colour.
fn walls_of(
    (triangles, opacity): (&[[u32; 3]], f32),
    placed: &[[f32; 4]],
    colours: &[[f32; 4]],
) -> Vec<Wall> {
    let vector = |texels: &[[f32; 4]], k: usize| {
        let [x, y, z, _] = texels[k];
        Vec3::new(x, y, z)
    };
    let wall = |triangle: &[u32; 3]| {
        let each = |of: &dyn Fn(usize) -> Vec3| {
            std::array::from_fn(|corner| of(triangle[corner] as usize))
        };
        Wall {
            corners: each(&|v| vector(placed, 3 * v)),
            normals: each(&|v| vector(placed, 3 * v + 1)),
            colours: each(&|v| linear_light(vector(colours, v))),
            opacity,
        }
    };
    triangles.iter().map(wall).collect()
}
