//! Render passes: draws declared and validated like compute passes.

use super::binding::{Bind, BindingList};
use super::device::lock;
use super::pipeline::PipelineDescription;
use super::struct_layout::GpuStruct;
use super::{Gpu, Recorder};
use crate::Result;

/// A draw that can be recorded into render passes with attachments of its formats.
///
/// The vertex shader fetches its data by `vertex_index`: there are no vertex buffers.
#[derive(Clone, Debug)]
pub struct Draw {
    pipeline: wgpu::RenderPipeline,
    bind_group: wgpu::BindGroup,
    params: Option<wgpu::Buffer>,
}

/// Builder of a draw; see [`Gpu::draw`].
#[must_use]
pub struct DrawBuilder<'a> {
    gpu: &'a Gpu,
    name: &'a str,
    sentence: BindingList<'a>,
    constants: Vec<(&'a str, f64)>,
    targets: Vec<Option<wgpu::ColorTargetState>>,
    depth: Option<wgpu::DepthStencilState>,
    primitive: wgpu::PrimitiveState,
}

impl Gpu {
    /// Starts the declaration of a draw with `shaders/{name}.wgsl`, entry points `vertex` and
    /// `fragment`; by default triangles without culling.
    pub fn draw<'a>(&'a self, name: &'a str) -> DrawBuilder<'a> {
        DrawBuilder {
            gpu: self,
            name,
            sentence: BindingList::default(),
            constants: Vec::new(),
            targets: Vec::new(),
            depth: None,
            primitive: wgpu::PrimitiveState::default(),
        }
    }
}

impl<'a> DrawBuilder<'a> {
    /// Sets a WGSL `override` constant.
    pub fn constant(mut self, name: &'a str, value: f64) -> Self {
        self.constants.push((name, value));
        self
    }

    /// Declares the next binding as read.
    pub fn read(mut self, what: &'a impl Bind) -> Self {
        self.sentence.read(what.resource());
        self
    }

    /// Declares the next binding as written by the fragment stage.
    pub fn write(mut self, what: &'a impl Bind) -> Self {
        self.sentence.write(what.resource());
        self
    }

    /// Declares the next binding as a uniform with these values; see [`Draw::set_params`].
    pub fn params<P: GpuStruct>(mut self, params: &'a P) -> Self {
        self.sentence.params(params);
        self
    }

    /// Adds a colour attachment of this format, with optional blending.
    pub fn target(mut self, format: wgpu::TextureFormat, blend: Option<wgpu::BlendState>) -> Self {
        self.targets.push(Some(wgpu::ColorTargetState {
            format,
            blend,
            write_mask: wgpu::ColorWrites::ALL,
        }));
        self
    }

    /// Adds a depth attachment of this format with a depth test, written if `write`.
    pub fn depth(
        mut self,
        format: wgpu::TextureFormat,
        compare: wgpu::CompareFunction,
        write: bool,
    ) -> Self {
        self.depth = Some(wgpu::DepthStencilState {
            format,
            depth_write_enabled: Some(write),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        });
        self
    }

    /// Sets the primitive topology and face culling.
    pub fn primitive(mut self, primitive: wgpu::PrimitiveState) -> Self {
        self.primitive = primitive;
        self
    }

    /// Validates the bindings and creates the draw.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) if shader and bindings disagree.
    pub fn build(self) -> Result<Draw> {
        let (gpu, name) = (self.gpu, self.name);
        let bound = self
            .sentence
            .check(gpu, name, wgpu::ShaderStages::VERTEX_FRAGMENT)?;
        let key = format!(
            "{name} {:?} {:?} {:?} {:?} {:?}",
            self.constants, bound.layout_entries, self.targets, self.depth, self.primitive
        );
        let known = lock(&gpu.pipelines().render).get(&key).cloned();
        let (pipeline, layout) = match known {
            Some(known) => known,
            None => {
                let made = self.pipeline(&bound.layout_entries)?;
                lock(&gpu.pipelines().render).insert(key, made.clone());
                made
            }
        };
        let bind_group = self
            .sentence
            .bind_group(gpu, name, &layout, &bound.params)?;
        Ok(Draw {
            pipeline,
            bind_group,
            params: bound.params.into_iter().next(),
        })
    }

    fn pipeline(
        &self,
        entries: &[wgpu::BindGroupLayoutEntry],
    ) -> Result<(wgpu::RenderPipeline, wgpu::BindGroupLayout)> {
        let (gpu, name) = (self.gpu, self.name);
        let layout = gpu.create(name, |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(name),
                entries,
            })
        })?;
        let source = super::Shaders::compose(name)?;
        let compilation_options = wgpu::PipelineCompilationOptions {
            constants: &self.constants,
            ..Default::default()
        };
        let pipeline = gpu.create(name, |device| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(name),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("vertex"),
                    compilation_options: compilation_options.clone(),
                    buffers: &[],
                },
                primitive: self.primitive,
                depth_stencil: self.depth.clone(),
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("fragment"),
                    compilation_options: compilation_options.clone(),
                    targets: &self.targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        })?;
        gpu.note_pipeline(PipelineDescription {
            targets: self.targets.iter().flatten().map(|t| t.format).collect(),
            depth: self.depth.as_ref().map(|d| d.format),
            ..PipelineDescription::new(name, &self.constants)
        });
        Ok((pipeline, layout))
    }
}

impl Draw {
    /// Records a draw of `vertices` vertices, `instances` times.
    pub fn record(&self, pass: &mut wgpu::RenderPass, vertices: u32, instances: u32) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind_group, &[]);
        pass.draw(0..vertices, 0..instances);
    }

    /// Records a draw of the first `count` vertices listed in `indices`, u32 each; the shader
    /// receives them as `vertex_index`.
    pub fn record_indexed(&self, pass: &mut wgpu::RenderPass, indices: &wgpu::Buffer, count: u32) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind_group, &[]);
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..count, 0, 0..1);
    }

    /// As [`Draw::record_indexed`], with the five u32 arguments in `arguments`.
    pub fn record_indexed_indirect(
        &self,
        pass: &mut wgpu::RenderPass,
        indices: &wgpu::Buffer,
        arguments: &wgpu::Buffer,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind_group, &[]);
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed_indirect(arguments, 0);
    }

    /// Records a draw with the four u32 arguments in `arguments` at byte `offset`.
    pub fn record_indirect(
        &self,
        pass: &mut wgpu::RenderPass,
        arguments: &wgpu::Buffer,
        offset: u64,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind_group, &[]);
        pass.draw_indirect(arguments, offset);
    }

    /// Replaces the parameters for draws recorded in `work` after this call; earlier and other
    /// recordings are unaffected. Not allowed inside a render pass.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) for parameters of a different size than at creation, or if
    /// the device cannot allocate them.
    pub fn set_params<P: GpuStruct>(&self, work: &mut Recorder, params: &P) -> Result<()> {
        match &self.params {
            Some(uniform) => work.write_uniform(uniform, params),
            None => Ok(()),
        }
    }
}
