//! Compute passes: prepared once, recorded every step.

use super::array::Version;
use super::binding::{Bind, BindingList};
use super::device::lock;
use super::pipeline::PipelineDescription;
use super::struct_layout::GpuStruct;
use super::{Gpu, Recorder};
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::Mutex;
use wgpu::naga;

/// Pipeline cache, keyed by shader, constants, layout and (render) attachments.
#[derive(Debug, Default)]
pub(super) struct Pipelines {
    pub(super) render: Mutex<HashMap<String, (wgpu::RenderPipeline, wgpu::BindGroupLayout)>>,
    compute: Mutex<HashMap<String, (wgpu::ComputePipeline, wgpu::BindGroupLayout)>>,
    pub(super) created: Mutex<Vec<PipelineDescription>>,
}

/// Size of a dispatch.
#[derive(Clone, Debug)]
enum Extent {
    Groups([u32; 3]),
    Indirect(wgpu::Buffer, u64),
}

/// A compute pass that can be recorded any number of times.
///
/// For ping-pong buffers, prepare one pass per direction: they share their pipeline.
#[derive(Clone, Debug)]
pub struct Pass {
    name: String,
    pipeline: wgpu::ComputePipeline,
    bind_group: wgpu::BindGroup,
    params: Option<wgpu::Buffer>,
    extent: Extent,
    /// Write counters of the arrays that it writes.
    versions: Vec<Version>,
}

/// Builder of a compute pass; see [`Gpu::pass`].
#[must_use]
pub struct PassBuilder<'a> {
    gpu: &'a Gpu,
    name: &'a str,
    sentence: BindingList<'a>,
    constants: Vec<(&'a str, f64)>,
    versions: Vec<Version>,
}

impl Gpu {
    /// Starts the declaration of a compute pass with `shaders/{name}.wgsl`, entry point `main`.
    ///
    /// Reads, writes and parameters are given in the order of the shader's bindings, from
    /// `@group(0) @binding(0)`.
    pub fn pass<'a>(&'a self, name: &'a str) -> PassBuilder<'a> {
        PassBuilder {
            gpu: self,
            name,
            sentence: BindingList::default(),
            constants: Vec::new(),
            versions: Vec::new(),
        }
    }
}

impl<'a> PassBuilder<'a> {
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

    /// Declares the next binding as written.
    pub fn write(mut self, what: &'a impl Bind) -> Self {
        self.sentence.write(what.resource());
        self.versions.extend(what.version().cloned());
        self
    }

    /// Declares the next binding as a uniform with these values; see [`Pass::set_params`].
    pub fn params<P: GpuStruct>(mut self, params: &'a P) -> Self {
        self.sentence.params(params);
        self
    }

    /// Prepares the pass over `items` items, one invocation each, folded into two dimensions.
    ///
    /// # Errors
    /// [`Error::Gpu`] if shader and bindings disagree.
    pub fn dispatch_items(self, items: u32) -> Result<Pass> {
        let name = self.name;
        self.prepare(|size| {
            let per_group = size[0];
            if size[1] * size[2] != 1 {
                return Err(Error::Gpu(format!(
                    "shaders/{name}.wgsl: workgroup size must be (n, 1, 1) to dispatch a list of \
                    items, got {size:?}"
                )));
            }
            let groups = items.div_ceil(per_group);
            // The workgroup limit per dimension on every WebGPU device.
            let x = groups.min(65_535);
            Ok(Extent::Groups([x, groups.div_ceil(x.max(1)), 1]))
        })
    }

    /// Prepares the pass over `groups` workgroups.
    ///
    /// # Errors
    /// As [`PassBuilder::dispatch_items`].
    pub fn dispatch_workgroups(self, groups: [u32; 3]) -> Result<Pass> {
        self.prepare(|_| Ok(Extent::Groups(groups)))
    }

    /// Prepares the pass with an indirect workgroup count: three u32 in `arguments` at byte
    /// `offset`, read when it runs.
    ///
    /// # Errors
    /// As [`PassBuilder::dispatch_items`].
    pub fn dispatch_indirect(self, arguments: &wgpu::Buffer, offset: u64) -> Result<Pass> {
        self.prepare(|_| Ok(Extent::Indirect(arguments.clone(), offset)))
    }

    fn prepare(self, extent: impl FnOnce([u32; 3]) -> Result<Extent>) -> Result<Pass> {
        let (gpu, name) = (self.gpu, self.name);
        let bound = self
            .sentence
            .check(gpu, name, wgpu::ShaderStages::COMPUTE)?;
        let extent = extent(workgroup_size(name, &bound.module, &self.constants)?)?;
        let key = format!("{name} {:?} {:?}", self.constants, bound.layout_entries);
        let known = lock(&gpu.pipelines().compute).get(&key).cloned();
        let (pipeline, layout) = match known {
            Some(known) => known,
            None => {
                let layout = gpu.create(name, |device| {
                    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                        label: Some(name),
                        entries: &bound.layout_entries,
                    })
                })?;
                let pipeline = compute_pipeline(gpu, name, &layout, &self.constants)?;
                gpu.note_pipeline(PipelineDescription::new(name, &self.constants));
                lock(&gpu.pipelines().compute).insert(key, (pipeline.clone(), layout.clone()));
                (pipeline, layout)
            }
        };
        let bind_group = self
            .sentence
            .bind_group(gpu, name, &layout, &bound.params)?;
        Ok(Pass {
            name: name.to_owned(),
            pipeline,
            bind_group,
            params: bound.params.into_iter().next(),
            extent,
            versions: self.versions,
        })
    }
}

impl Pass {
    /// Records the pass and increments the versions of the arrays that it writes.
    pub fn record(&self, work: &mut Recorder) {
        if matches!(self.extent, Extent::Groups(groups) if groups.contains(&0)) {
            return;
        }
        self.versions.iter().for_each(Version::next);
        work.compute(&self.name, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.bind_group, &[]);
            match &self.extent {
                Extent::Groups([x, y, z]) => pass.dispatch_workgroups(*x, *y, *z),
                Extent::Indirect(arguments, offset) => {
                    pass.dispatch_workgroups_indirect(arguments, *offset);
                }
            }
        });
    }

    /// Replaces the parameters for passes recorded in `work` after this call; earlier and other
    /// recordings are unaffected. Not allowed inside a render pass.
    ///
    /// # Errors
    /// [`Error::Gpu`] for parameters of a different size than at creation, or if the device cannot
    /// allocate them.
    pub fn set_params<P: GpuStruct>(&self, work: &mut Recorder, params: &P) -> Result<()> {
        match &self.params {
            Some(uniform) => work.write_uniform(uniform, params),
            None => Ok(()),
        }
    }
}

fn compute_pipeline(
    gpu: &Gpu,
    name: &str,
    layout: &wgpu::BindGroupLayout,
    constants: &[(&str, f64)],
) -> Result<wgpu::ComputePipeline> {
    let source = super::Shaders::compose(name)?;
    gpu.create(name, |device| {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Our shaders write workgroup memory before they read it.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        })
    })
}

/// Returns the workgroup size of entry point `main`, with overrides replaced by `constants`.
fn workgroup_size(
    name: &str,
    module: &naga::Module,
    constants: &[(&str, f64)],
) -> Result<[u32; 3]> {
    let wrong = |what: &str| Error::Gpu(format!("shaders/{name}.wgsl: {what}"));
    let main = module
        .entry_points
        .iter()
        .find(|e| e.name == "main" && e.stage == naga::ShaderStage::Compute)
        .ok_or_else(|| wrong("has no compute entry point `main`"))?;
    let mut size = main.workgroup_size;
    let overrides = main.workgroup_size_overrides.unwrap_or_default();
    for (axis, expression) in overrides.iter().enumerate() {
        let Some(expression) = expression else {
            continue;
        };
        size[axis] = override_value(module, *expression, constants).ok_or_else(|| {
            wrong(
                "workgroup size must be a number or an override without \
                expression",
            )
        })?;
    }
    Ok(size)
}

fn override_value(
    module: &naga::Module,
    expression: naga::Handle<naga::Expression>,
    constants: &[(&str, f64)],
) -> Option<u32> {
    match &module.global_expressions[expression] {
        naga::Expression::Literal(naga::Literal::U32(n)) => Some(*n),
        naga::Expression::Literal(naga::Literal::I32(n)) => u32::try_from(*n).ok(),
        naga::Expression::Override(handle) => {
            let declared = &module.overrides[*handle];
            let given = constants
                .iter()
                .find(|(name, _)| Some(*name) == declared.name.as_deref());
            match given {
                Some((_, value)) => Some(*value as u32),
                None => override_value(module, declared.init?, constants),
            }
        }
        _ => None,
    }
}
