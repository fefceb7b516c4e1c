//! Records passes into an encoder, owned by this crate or by the caller.

use super::struct_layout::GpuStruct;
use super::timing::TimestampQueries;
use super::{Array, Gpu};
use crate::{Error, Result};

/// A command encoder with its passes.
///
/// Consecutive compute passes share one WebGPU pass (each dispatch sees the writes of those before
/// it), unless passes are being timed.
pub struct Recorder<'e> {
    gpu: Gpu,
    encoder: Encoder<'e>,
    open: Option<wgpu::ComputePass<'static>>,
    marks: Option<TimestampQueries>,
    /// The last parameters, and the buffer that holds them.
    given: Option<(Vec<u8>, wgpu::Buffer)>,
}

enum Encoder<'e> {
    Own(wgpu::CommandEncoder),
    Callers(&'e mut wgpu::CommandEncoder),
}

impl Gpu {
    /// Starts recording into an encoder of its own.
    pub fn start_recording(&self) -> Recorder<'static> {
        let encoder = self
            .device()
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None });
        Recorder {
            gpu: self.clone(),
            encoder: Encoder::Own(encoder),
            open: None,
            marks: self.timer().begin(self.device()),
            given: None,
        }
    }
}

impl<'e> Recorder<'e> {
    /// Starts recording into the caller's encoder, which the caller submits.
    pub fn with_encoder(gpu: &Gpu, encoder: &'e mut wgpu::CommandEncoder) -> Recorder<'e> {
        Recorder {
            gpu: gpu.clone(),
            encoder: Encoder::Callers(encoder),
            open: None,
            marks: None,
            given: None,
        }
    }

    /// Returns the device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Ends the open compute pass and returns the encoder, for copies and clears.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.open = None;
        match &mut self.encoder {
            Encoder::Own(encoder) => encoder,
            Encoder::Callers(encoder) => encoder,
        }
    }

    /// Records a compute dispatch under `name`.
    pub(super) fn compute(&mut self, name: &str, dispatch: impl FnOnce(&mut wgpu::ComputePass)) {
        self.gpu.count_pass(name);
        if let Some(marks) = &mut self.marks
            && let Some((queries, start, end)) = marks.next(name)
        {
            let mut pass = self
                .encoder()
                .begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some(name),
                    timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                        query_set: &queries,
                        beginning_of_pass_write_index: Some(start),
                        end_of_pass_write_index: Some(end),
                    }),
                });
            dispatch(&mut pass);
            return;
        }
        let mut pass = match self.open.take() {
            Some(pass) => pass,
            None => self
                .encoder()
                .begin_compute_pass(&wgpu::ComputePassDescriptor::default())
                .forget_lifetime(),
        };
        dispatch(&mut pass);
        self.open = Some(pass);
    }

    /// Begins a render pass under `name`.
    pub fn render_pass<'p>(
        &'p mut self,
        name: &str,
        colours: &[Option<wgpu::RenderPassColorAttachment<'_>>],
        depth: Option<wgpu::RenderPassDepthStencilAttachment<'_>>,
    ) -> wgpu::RenderPass<'p> {
        self.gpu.count_pass(name);
        let mark = self.marks.as_mut().and_then(|marks| marks.next(name));
        self.encoder()
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: colours,
                depth_stencil_attachment: depth,
                timestamp_writes: mark.as_ref().map(|(queries, start, end)| {
                    wgpu::RenderPassTimestampWrites {
                        query_set: queries,
                        beginning_of_pass_write_index: Some(*start),
                        end_of_pass_write_index: Some(*end),
                    }
                }),
                occlusion_query_set: None,
                multiview_mask: None,
            })
    }

    /// Records a copy of `params` into `uniform`, for everything recorded after it. The values
    /// belong to this recording: the submission order of other recordings does not matter.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the sizes differ or the device fails.
    pub(super) fn write_uniform<P: GpuStruct>(
        &mut self,
        uniform: &wgpu::Buffer,
        params: &P,
    ) -> Result<()> {
        let bytes = bytemuck::bytes_of(params);
        if uniform.size() != bytes.len() as u64 {
            return Err(Error::Gpu(format!(
                "got {} bytes of {} for a parameter buffer of {} bytes",
                bytes.len(),
                P::NAME,
                uniform.size()
            )));
        }
        // The draws of one image share their view parameters.
        let given = match self.given.take().filter(|(known, _)| known == bytes) {
            Some(given) => given,
            None => (bytes.to_vec(), self.gpu.parameters(P::NAME, bytes)?),
        };
        self.encoder()
            .copy_buffer_to_buffer(&given.1, 0, uniform, 0, uniform.size());
        self.given = Some(given);
        Ok(())
    }

    /// Records a copy of an array into another of the same format and length.
    pub fn copy_array(&mut self, from: &Array, to: &Array) {
        debug_assert_eq!((from.texel(), from.len()), (to.texel(), to.len()));
        to.mark_written();
        let (from, to) = (from.texture(), to.texture());
        // Their capacities may differ.
        let size = wgpu::Extent3d {
            width: from.width().min(to.width()),
            height: from.height().min(to.height()),
            depth_or_array_layers: 1,
        };
        self.encoder()
            .copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), size);
    }

    /// Submits the recording, if the encoder is owned; a caller's encoder is submitted by the
    /// caller. Does not block.
    ///
    /// # Errors
    /// As [`Gpu::poll_errors`].
    pub fn submit(mut self) -> Result<()> {
        self.open = None;
        let marks = self.marks.take();
        let gpu = self.gpu.clone();
        let times = marks.and_then(|marks| marks.resolve(&gpu, self.encoder()));
        if let Encoder::Own(encoder) = self.encoder {
            self.gpu.submit([encoder.finish()]);
        }
        // Only now: `Gpu::timings` on another thread must not map a buffer before its submission.
        if let Some(times) = times {
            self.gpu.timer().add(times);
        }
        self.gpu.poll_errors()
    }
}
