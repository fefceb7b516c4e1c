//! Skin vertices in the deformed state.

use super::draw::Skin;
use crate::Result;
use crate::gpu::{Array, Texel};
use crate::skin::basis::SkinnedVertex;
use glam::{DVec3, Vec3};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Place {
            pub vertices: u32,
        }
    }
}

impl Skin {
    /// Returns the drawn vertices in the deformed state: positions in file units, normals and
    /// tangents. Waits and reads back.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn skinned_vertices(&self) -> Result<Vec<SkinnedVertex>> {
        let texels: Vec<[f32; 4]> = self.gpu.read_array(&self.placed_array()?)?;
        let vector = |t: [f32; 4]| Vec3::new(t[0], t[1], t[2]);
        Ok(texels
            .chunks_exact(3)
            .map(|t| SkinnedVertex {
                position: self.carrier.frame.to_file(vector(t[0])),
                normal: vector(t[1]).as_dvec3(),
                tangent: vector(t[2]).as_dvec3(),
            })
            .collect())
    }

    /// Computes the deformed vertices on the GPU, in the local frame: three items a vertex.
    pub(super) fn placed_array(&self) -> Result<Array> {
        let count = self.bound.len() as u32;
        let result = self
            .gpu
            .array("placed vertices", Texel::F32x4, 3 * count as usize)?;
        let place = self
            .gpu
            .pass("skin/skinned_vertices")
            .read(&self.carrier.positions)
            .read(&self.carrier.normals)
            .read(&self.records)
            .write(&result)
            .params(&gpu_data::Place { vertices: count })
            .dispatch_items(count)?;
        let mut work = self.gpu.start_recording();
        self.carrier.record_normals(&mut work);
        place.record(&mut work);
        work.submit()?;
        Ok(result)
    }

    /// Returns the surface's vertices in the deformed state, in file units and file order; NaN for
    /// vertices without a triangle. Waits and reads back.
    ///
    /// # Errors
    /// As [`Skin::skinned_vertices`].
    pub fn vertices(&self) -> Result<Vec<DVec3>> {
        let placed = self.skinned_vertices()?;
        let mut vertices = vec![DVec3::NAN; self.report.vertices];
        for (placed, source) in placed.iter().zip(&self.vertices.sources) {
            vertices[*source as usize] = placed.position;
        }
        Ok(vertices)
    }
}
