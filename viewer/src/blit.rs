//! Blits the picture and the cached interface to the window in dedicated passes; egui's general
//! shader takes as long as the picture itself.

use eframe::egui_wgpu::{self, RenderState};
use eframe::{egui, egui_wgpu::CallbackResources};

const SHADER: &str = include_str!("blit.wgsl");

/// Draws a texture over a rectangle of the interface.
#[derive(Debug)]
pub(crate) struct Blit {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// Creates a blit for pictures of any size onto the interface's target.
    pub fn new(state: &RenderState) -> Blit {
        Blit::with(state, "pixel")
    }

    /// Creates a blit for textures of the target's size, pixel by pixel.
    #[cfg_attr(target_arch = "wasm32", allow(dead_code))]
    pub fn exact(state: &RenderState) -> Blit {
        Blit::with(state, "same_pixel")
    }

    fn with(state: &RenderState, pixel: &str) -> Blit {
        let device = &state.device;
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("blit"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let linear = f64::from(u8::from(state.target_format.is_srgb()));
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("blit"),
            entries: &[
                entry(
                    0,
                    wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: true },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                ),
                entry(
                    1,
                    wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                ),
            ],
        });
        let laid_out = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("blit"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blit"),
            layout: Some(&laid_out),
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
                entry_point: Some(pixel),
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
            layout,
            pipeline,
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// Creates the bind group of a texture.
    pub fn bind_texture(&self, device: &wgpu::Device, view: &wgpu::TextureView) -> wgpu::BindGroup {
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

    /// Returns the shape that draws `texture` over `rect`; `until` is dropped once the frame is
    /// presented.
    pub fn shape(
        &self,
        texture: &wgpu::BindGroup,
        rect: egui::Rect,
        until: Option<PresentCallback>,
    ) -> egui::Shape {
        let drawn = TexturedRect {
            pipeline: self.pipeline.clone(),
            texture: texture.clone(),
            sides: None,
            _until: until,
        };
        egui_wgpu::Callback::new_paint_callback(rect, drawn).into()
    }

    /// Returns the shape that draws the borders of a `texture` of the same size as the `screen`.
    #[cfg_attr(target_arch = "wasm32", allow(dead_code))]
    pub fn border_shape(
        &self,
        texture: &wgpu::BindGroup,
        screen: egui::Rect,
        sides: ImageBorders,
    ) -> egui::Shape {
        let drawn = TexturedRect {
            pipeline: self.pipeline.clone(),
            texture: texture.clone(),
            sides: Some(sides),
            _until: None,
        };
        egui_wgpu::Callback::new_paint_callback(screen, drawn).into()
    }
}

/// Pixel rectangles, each as two opposite corners.
#[cfg_attr(target_arch = "wasm32", allow(dead_code))]
pub(crate) struct ImageBorders(pub [[[u32; 2]; 2]; 4]);

/// Runs a callback when the frame that it is part of is presented, that is, when it is dropped.
pub(crate) struct PresentCallback(pub Box<dyn Fn() + Send + Sync>);

impl Drop for PresentCallback {
    fn drop(&mut self) {
        (self.0)();
    }
}

struct TexturedRect {
    pipeline: wgpu::RenderPipeline,
    texture: wgpu::BindGroup,
    sides: Option<ImageBorders>,
    _until: Option<PresentCallback>,
}

impl egui_wgpu::CallbackTrait for TexturedRect {
    fn paint(
        &self,
        info: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.texture, &[]);
        let Some(ImageBorders(sides)) = &self.sides else {
            pass.draw(0..3, 0..1);
            return;
        };
        let size = info.screen_size_px;
        for [low, high] in sides {
            let [low, high] = [low, high].map(|at| [at[0].min(size[0]), at[1].min(size[1])]);
            let [width, height] = [0, 1].map(|k| high[k].saturating_sub(low[k]));
            if width > 0 && height > 0 {
                pass.set_scissor_rect(low[0], low[1], width, height);
                pass.draw(0..3, 0..1);
            }
        }
    }
}
