//! What a raycaster tells about itself, read back.

use super::Camera;
use super::raycast_options::{Gathered, RaycastReport};
use super::raycaster::Raycaster;
use super::view::View;
use crate::Result;
use crate::gpu::Texel;

impl Raycaster {
    /// What the rays of a picture meet, at the present positions. Draws it once more, whole rays,
    /// and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn report(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaycastReport> {
        self.gpu.queue().write_buffer(&self.lost, 0, &[0; 4]);
        let (pixels, layers) = self.gather(camera, size, Gathered::Statistics)?;
        let lost = self.gpu.read_buffer::<u32>(&self.lost)?;
        self.check_layers(layers)?;
        let rays = pixels.iter().filter(|p| p[1] > 0.0).count() as u64;
        let steps: f64 = pixels.iter().map(|p| f64::from(p[0])).sum();
        Ok(RaycastReport {
            rays,
            lost_rays: lost.first().copied().unwrap_or(0).into(),
            tets_per_ray: steps / (rays.max(1) as f64),
            peel_layers: layers,
            inverted: self.geometry.inverted()?,
        })
    }

    /// What the table gives for `segments` (scalar in front, scalar behind, length; file units):
    /// colour premultiplied by opacity, and opacity. To be held against
    /// [`segment_integral`](crate::reference::segment_integral). Waits and reads back.
    ///
    /// # Errors
    /// When the device cannot hold them.
    pub fn look_up(&mut self, segments: &[[f64; 3]]) -> Result<Vec<[f32; 4]>> {
        let (low, high) = self.geometry.range;
        let share = |s: f64| ((s - low) / (high - low)) as f32;
        let scale = self.geometry.frame.scale;
        let given: Vec<[f32; 4]> = segments
            .iter()
            .map(|[front, back, d]| [share(*front), share(*back), (d / scale) as f32, 0.0])
            .collect();
        let given = self.gpu.array_of("segments", Texel::F32x4, &given)?;
        let found = self.gpu.array("looked up", Texel::F32x4, segments.len())?;
        let view = View {
            scalar: self.table.scalar(),
            opacity: self.table.opacity,
            nodes: given.len(),
            layers: self.table.layers,
            reach: self.table.reach,
            ..bytemuck::Zeroable::zeroed()
        };
        let pass = self
            .gpu
            .pass("render/look_up")
            .constant("TABLE", self.options.table.code())
            .constant("SAMPLES", self.options.table.samples())
            .constant("OPAQUE", self.options.opaque)
            .read(&given)
            .read(&self.table.view)
            .read(&self.sampler)
            .write(&found)
            .params(&view)
            .over(given.len())?;
        let mut work = self.gpu.record();
        self.table.record(&mut work);
        pass.record(&mut work);
        work.submit()?;
        self.gpu.read_array(&found)
    }
}
