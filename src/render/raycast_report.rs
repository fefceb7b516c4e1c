//! Ray statistics and table samples of a raycaster, read back from the GPU.

use super::Camera;
use super::depth_peeling::attachment;
use super::image_tiles::{check_size, copy_tile, draw_in_tiles};
use super::raycast_options::{Integrand, RaycastReport, Target};
use super::raycaster::Raycaster;
use super::view::{ImageRegion, View};
use crate::Result;
use crate::gpu::{Recorder, Texel};

/// Format of the exit counts, in 255ths, and their additive blending.
const EXIT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;
const ADDED: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::One,
    dst_factor: wgpu::BlendFactor::One,
    operation: wgpu::BlendOperation::Add,
};

impl Raycaster {
    /// Returns the ray statistics of an image at the current positions. Renders it once more
    /// without early ray termination and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn report(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaycastReport> {
        check_size(size)?;
        let gpu = self.gpu.clone();
        gpu.queue().write_buffer(&self.lost_rays, 0, &[0; 4]);
        let mut layers = 0;
        let mut exits: Vec<u8> = Vec::new();
        let mut counter: Option<wgpu::TextureView> = None;
        let pixels = draw_in_tiles(&gpu, size, |colour, window| {
            let counter = match counter.take() {
                Some(kept) => counter.insert(kept),
                None => counter.insert(gpu.target(
                    "exits",
                    window.size,
                    EXIT_FORMAT,
                    wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
                )?),
            };
            let target = Target {
                colour,
                depth: None,
                background: Some([0.0; 4]),
            };
            let mut work = gpu.start_recording();
            self.record_window(&mut work, camera, Integrand::Statistics, &target, window)?;
            self.record_exits(&mut work, camera, window, counter)?;
            work.submit()?;
            layers = layers.max(self.layers_found()?);
            copy_tile(&mut exits, window, &gpu.read_texture(counter.texture())?);
            Ok(())
        })?;
        let lost = gpu.read_buffer::<u32>(&self.lost_rays)?;
        self.check_layers(layers)?;
        // Values per ray: tets, whether the ray starts, number of starts.
        let met = |(p, out): (&[f32; 4], &u8)| p[1] > 0.0 || *out > 0;
        let uneven = |(p, out): (&[f32; 4], &u8)| p[2].min(255.0) as u8 != *out;
        let both = || pixels.iter().zip(&exits);
        let rays = both().filter(|b| met(*b)).count() as u64;
        let missed = both().filter(|b| uneven(*b)).count() as u64;
        let steps: f64 = pixels.iter().map(|p| f64::from(p[0])).sum();
        Ok(RaycastReport {
            rays,
            lost_rays: u64::from(lost.first().copied().unwrap_or(0)) + missed,
            tets_per_ray: steps / (rays.max(1) as f64),
            peel_layers: layers,
            inverted: self.geometry.count_inverted()?,
        })
    }

    /// Records the count of boundary faces through which each ray exits; the nodes must already be
    /// projected.
    fn record_exits(
        &self,
        work: &mut Recorder,
        camera: &Camera,
        window: ImageRegion,
        counter: &wgpu::TextureView,
    ) -> Result<()> {
        let view = self.view(camera, window);
        let draw = self
            .gpu
            .draw("render/count_exits")
            .constant("BACK_FACES", 1.0)
            .read(&self.geometry.projected)
            .read(&self.geometry.boundary)
            .params(&view)
            .target(
                EXIT_FORMAT,
                Some(wgpu::BlendState {
                    color: ADDED,
                    alpha: ADDED,
                }),
            )
            .build()?;
        let clear = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
        let colour = [attachment(counter, clear)];
        let mut pass = work.render_pass("render/count_exits", &colour, None);
        draw.record(&mut pass, view.corners, 1);
        Ok(())
    }

    /// Returns the table result for `segments` (front scalar, back scalar, length; file units):
    /// premultiplied colour, and opacity. For comparison with
    /// [`AbsoluteTransferFunction::segment_integral`](crate::render::AbsoluteTransferFunction::segment_integral). Waits and reads back.
    ///
    /// # Errors
    /// An error if the device cannot hold the segments.
    pub fn sample_table(&mut self, segments: &[[f64; 3]]) -> Result<Vec<[f32; 4]>> {
        let (low, high) = self.geometry.range;
        let share = |s: f64| ((s - low) / (high - low)) as f32;
        let scale = self.geometry.frame.scale;
        let given: Vec<[f32; 4]> = segments
            .iter()
            .map(|[front, back, d]| [share(*front), share(*back), (d / scale) as f32, 0.0])
            .collect();
        let given = self.gpu.array_of("segments", Texel::F32x4, &given)?;
        let found = self
            .gpu
            .array("table samples", Texel::F32x4, segments.len())?;
        let table = &self.looks.table;
        let view = View {
            scalar: table.scalar,
            opacity: table.opacity,
            nodes: given.len(),
            layers: table.layers,
            table_max_depth: table.max_depth,
            ..bytemuck::Zeroable::zeroed()
        };
        let form = table.form;
        let stored = self.options.reads.are_stored(&self.gpu);
        let name = format!("render/table_lookup {}", form.term(stored));
        let mut pass = self.gpu.pass(&name).read(&given).write(&found);
        for (constant, value) in table.constants() {
            pass = pass.constant(constant, *value);
        }
        pass = pass.params(&view).read(&table.view);
        if form.is_sampled() {
            pass = pass.read(&self.sampler);
        }
        let pass = pass.dispatch_items(given.len())?;
        self.looks.table.fill(&self.gpu)?;
        let mut work = self.gpu.start_recording();
        pass.record(&mut work);
        work.submit()?;
        self.gpu.read_array(&found)
    }
}
