//! The picture onto the window, by a pass that does nothing else: the interface's own shader takes as
//! long for it as the picture itself.

use eframe::egui_wgpu::{self, RenderState};
use eframe::{egui, egui_wgpu::CallbackResources};

const SHADER: &str = include_str!("blit.wgsl");

/// What draws a texture over a rectangle of the interface.
#[derive(Debug)]
pub(crate) struct Blit {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// For what the interface is drawn into.
    pub fn new(state: &RenderState) -> Blit {
        let device = &state.device;
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("blit"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let linear = f64::from(u8::from(state.target_format.is_srgb()));
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blit"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("pixel"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("LINEAR", linear)],
                    ..Default::default()
                },
                targets: &[Some(state.target_format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Blit {
            layout: pipeline.get_bind_group_layout(0),
            pipeline,
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// The texture, ready to be drawn.
    pub fn of(&self, device: &wgpu::Device, view: &wgpu::TextureView) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("blit"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        })
    }

    /// The shape that draws `texture` over `rect`.
    pub fn shape(&self, texture: &wgpu::BindGroup, rect: egui::Rect) -> egui::Shape {
        let drawn = Drawn {
            pipeline: self.pipeline.clone(),
            texture: texture.clone(),
        };
        egui_wgpu::Callback::new_paint_callback(rect, drawn).into()
    }
}

struct Drawn {
    pipeline: wgpu::RenderPipeline,
    texture: wgpu::BindGroup,
}

impl egui_wgpu::CallbackTrait for Drawn {
    fn paint(
        &self,
        _: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.texture, &[]);
        pass.draw(0..3, 0..1);
    }
}
