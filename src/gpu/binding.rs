//! Creates bind groups from the bindings of a pass, validated against the WGSL declarations.

use super::array::Version;
use super::struct_layout::GpuStruct;
use super::{Gpu, shader, struct_layout};
use crate::{Error, Result};
use std::sync::Arc;
use wgpu::naga;

/// A resource that can be bound to a shader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resource<'a> {
    /// A sampled, loaded or stored texture.
    Texture(&'a wgpu::TextureView),
    /// A whole storage buffer.
    Buffer(&'a wgpu::Buffer),
    /// A sampler.
    Sampler(&'a wgpu::Sampler),
}

/// Types that can be bound to a pass.
pub trait Bind {
    /// Returns the resource.
    fn resource(&self) -> Resource<'_>;

    /// Returns its write counter, if it has one.
    fn version(&self) -> Option<&Version> {
        None
    }
}

impl Bind for wgpu::TextureView {
    fn resource(&self) -> Resource<'_> {
        Resource::Texture(self)
    }
}
impl Bind for wgpu::Buffer {
    fn resource(&self) -> Resource<'_> {
        Resource::Buffer(self)
    }
}
impl Bind for wgpu::Sampler {
    fn resource(&self) -> Resource<'_> {
        Resource::Sampler(self)
    }
}

/// One binding.
enum Word<'a> {
    Read(Resource<'a>),
    Write(Resource<'a>),
    Params {
        bytes: &'a [u8],
        compare: fn(&str, &naga::TypeInner) -> Result<()>,
    },
}

/// Bindings of a pass, in order.
#[derive(Default)]
pub(super) struct BindingList<'a> {
    words: Vec<Word<'a>>,
}

/// Bindings validated against their shader, for the creation of pipelines and bind groups.
pub(super) struct ValidatedBindings {
    pub(super) module: Arc<naga::Module>,
    pub(super) layout_entries: Vec<wgpu::BindGroupLayoutEntry>,
    /// Uniform buffers, in binding order.
    pub(super) params: Vec<wgpu::Buffer>,
}

impl<'a> BindingList<'a> {
    pub(super) fn read(&mut self, r: Resource<'a>) {
        self.words.push(Word::Read(r));
    }

    pub(super) fn write(&mut self, r: Resource<'a>) {
        self.words.push(Word::Write(r));
    }

    pub(super) fn params<P: GpuStruct>(&mut self, p: &'a P) {
        self.words.push(Word::Params {
            bytes: bytemuck::bytes_of(p),
            compare: struct_layout::compare::<P>,
        });
    }

    /// Validates the bindings against the WGSL of `name` and creates the uniform buffers.
    pub(super) fn check(
        &self,
        gpu: &Gpu,
        name: &str,
        visibility: wgpu::ShaderStages,
    ) -> Result<ValidatedBindings> {
        let module = shader::parsed(name)?;
        let wrong = |what: String| Error::Gpu(format!("shaders/{name}.wgsl: {what}"));
        let mut declared: Vec<(u32, &naga::GlobalVariable)> = module
            .global_variables
            .iter()
            .filter_map(|(_, g)| g.binding.map(|b| (b.binding, g)))
            .collect();
        declared.sort_by_key(|(binding, _)| *binding);
        if declared.len() != self.words.len()
            || declared.iter().enumerate().any(|(i, d)| d.0 != i as u32)
        {
            return Err(wrong(format!(
                "declares bindings {:?}, but {} resources are bound in order from 0",
                declared.iter().map(|d| d.0).collect::<Vec<_>>(),
                self.words.len()
            )));
        }
        let mut layout_entries = Vec::new();
        let mut params = Vec::new();
        for ((binding, global), word) in declared.iter().zip(&self.words) {
            let variable = global.name.as_deref().unwrap_or("?");
            let ty = check_binding_type(gpu, &module, global, word)
                .map_err(|what| wrong(format!("binding {binding}, {variable}: {what}")))?;
            if let Word::Params { bytes, compare } = word {
                compare(name, &module.types[global.ty].inner)?;
                params.push(gpu.uniform(name, bytes)?);
            }
            let writable = matches!(
                ty,
                wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: false },
                    ..
                } | wgpu::BindingType::StorageTexture {
                    access: wgpu::StorageTextureAccess::WriteOnly,
                    ..
                }
            );
            layout_entries.push(wgpu::BindGroupLayoutEntry {
                binding: *binding,
                // Writes in the vertex stage require a feature that not every device has.
                visibility: if writable {
                    visibility.difference(wgpu::ShaderStages::VERTEX)
                } else {
                    visibility
                },
                ty,
                count: None,
            });
        }
        for (i, a) in self.words.iter().enumerate() {
            for b in &self.words[i + 1..] {
                let clash = match (a, b) {
                    (Word::Read(a), Word::Write(b))
                    | (Word::Write(a), Word::Read(b))
                    | (Word::Write(a), Word::Write(b)) => a == b,
                    _ => false,
                };
                if clash {
                    return Err(wrong(format!(
                        "resource {a:?} is bound twice, at least once for writing",
                        a = match a {
                            Word::Read(r) | Word::Write(r) => Some(r),
                            Word::Params { .. } => None,
                        }
                    )));
                }
            }
        }
        Ok(ValidatedBindings {
            module,
            layout_entries,
            params,
        })
    }

    /// Creates the bind group for a layout made from [`ValidatedBindings::layout_entries`].
    pub(super) fn bind_group(
        &self,
        gpu: &Gpu,
        name: &str,
        layout: &wgpu::BindGroupLayout,
        params: &[wgpu::Buffer],
    ) -> Result<wgpu::BindGroup> {
        let mut params = params.iter();
        let entries: Vec<wgpu::BindGroupEntry> = self
            .words
            .iter()
            .enumerate()
            .filter_map(|(i, word)| {
                let resource = match word {
                    Word::Read(r) | Word::Write(r) => match r {
                        Resource::Texture(view) => wgpu::BindingResource::TextureView(view),
                        Resource::Buffer(buffer) => buffer.as_entire_binding(),
                        Resource::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                    },
                    Word::Params { .. } => params.next()?.as_entire_binding(),
                };
                Some(wgpu::BindGroupEntry {
                    binding: i as u32,
                    resource,
                })
            })
            .collect();
        gpu.create(name, |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(name),
                layout,
                entries: &entries,
            })
        })
    }
}

impl Gpu {
    fn uniform(&self, label: &str, bytes: &[u8]) -> Result<wgpu::Buffer> {
        self.small_buffer(label, bytes, wgpu::BufferUsages::UNIFORM)
    }

    /// Creates a buffer as a copy source of parameters.
    pub(super) fn parameters(&self, label: &str, bytes: &[u8]) -> Result<wgpu::Buffer> {
        self.small_buffer(label, bytes, wgpu::BufferUsages::COPY_SRC)
    }

    fn small_buffer(
        &self,
        label: &str,
        bytes: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer> {
        let buffer = self.create(label, |device| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes.len() as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })?;
        self.queue().write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }
}

/// Returns the binding type declared in the WGSL, if it matches the given binding.
fn check_binding_type(
    gpu: &Gpu,
    module: &naga::Module,
    global: &naga::GlobalVariable,
    word: &Word,
) -> std::result::Result<wgpu::BindingType, String> {
    let inner = &module.types[global.ty].inner;
    let buffer = |ty| wgpu::BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    match (global.space, inner, word) {
        (naga::AddressSpace::Uniform, _, Word::Params { .. }) => {
            Ok(buffer(wgpu::BufferBindingType::Uniform))
        }
        (naga::AddressSpace::Storage { access }, _, Word::Read(Resource::Buffer(_)))
            if !access.contains(naga::StorageAccess::STORE) =>
        {
            Ok(buffer(wgpu::BufferBindingType::Storage { read_only: true }))
        }
        (naga::AddressSpace::Storage { access }, _, Word::Write(Resource::Buffer(_)))
            if access.contains(naga::StorageAccess::STORE) =>
        {
            Ok(buffer(wgpu::BufferBindingType::Storage {
                read_only: false,
            }))
        }
        (_, naga::TypeInner::Sampler { comparison }, Word::Read(Resource::Sampler(_))) => {
            Ok(wgpu::BindingType::Sampler(if *comparison {
                wgpu::SamplerBindingType::Comparison
            } else {
                wgpu::SamplerBindingType::Filtering
            }))
        }
        (
            _,
            naga::TypeInner::Image {
                dim,
                arrayed,
                class,
            },
            Word::Read(Resource::Texture(view)) | Word::Write(Resource::Texture(view)),
        ) => image_type(gpu, module, *dim, *arrayed, *class, view, word),
        _ => Err(format!(
            "declared as {:?}, but bound to {}",
            global.space,
            match word {
                Word::Read(r) => format!("{r:?} for reading"),
                Word::Write(r) => format!("{r:?} for writing"),
                Word::Params { .. } => "a parameter struct".into(),
            }
        )),
    }
}

/// Returns the type of a binding declared as an image, to which `view` is given.
fn image_type(
    gpu: &Gpu,
    module: &naga::Module,
    dim: naga::ImageDimension,
    arrayed: bool,
    class: naga::ImageClass,
    view: &wgpu::TextureView,
    word: &Word,
) -> std::result::Result<wgpu::BindingType, String> {
    let view_dimension = match (dim, arrayed) {
        (naga::ImageDimension::D1, _) => wgpu::TextureViewDimension::D1,
        (naga::ImageDimension::D2, false) => wgpu::TextureViewDimension::D2,
        (naga::ImageDimension::D2, true) => wgpu::TextureViewDimension::D2Array,
        (naga::ImageDimension::D3, _) => wgpu::TextureViewDimension::D3,
        (naga::ImageDimension::Cube, _) => wgpu::TextureViewDimension::Cube,
    };
    let format = view.texture().format();
    match (class, word) {
        (naga::ImageClass::Sampled { kind, multi }, Word::Read(_)) => {
            Ok(wgpu::BindingType::Texture {
                sample_type: sample_type(gpu, module, kind, format)?,
                view_dimension,
                multisampled: multi,
            })
        }
        (naga::ImageClass::Depth { multi }, Word::Read(_)) => Ok(wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension,
            multisampled: multi,
        }),
        (
            naga::ImageClass::Storage {
                format: declared,
                access,
            },
            Word::Write(_) | Word::Read(_),
        ) => {
            let (wanted, given, word) = match word {
                Word::Write(_) => (
                    naga::StorageAccess::STORE,
                    "write",
                    wgpu::StorageTextureAccess::WriteOnly,
                ),
                _ => (
                    naga::StorageAccess::LOAD,
                    "read",
                    wgpu::StorageTextureAccess::ReadOnly,
                ),
            };
            if access != wanted {
                return Err(format!("bound for {given} access; declare it `{given}`"));
            }
            let declared = storage_format(declared)
                .ok_or_else(|| format!("storage format {declared:?} is not supported"))?;
            if declared != format {
                return Err(format!(
                    "declared as {declared:?}, but bound to a texture of format \
                    {format:?}"
                ));
            }
            Ok(wgpu::BindingType::StorageTexture {
                access: word,
                format,
                view_dimension,
            })
        }
        _ => Err("declared for reading, but bound for writing".into()),
    }
}

/// Returns the type of samples of `kind` from a texture of `format`.
fn sample_type(
    gpu: &Gpu,
    module: &naga::Module,
    kind: naga::ScalarKind,
    format: wgpu::TextureFormat,
) -> std::result::Result<wgpu::TextureSampleType, String> {
    let features = format.guaranteed_format_features(gpu.device().features());
    let filterable = features
        .flags
        .contains(wgpu::TextureFormatFeatureFlags::FILTERABLE)
        && module
            .types
            .iter()
            .any(|(_, t)| matches!(t.inner, naga::TypeInner::Sampler { .. }));
    match kind {
        naga::ScalarKind::Float => Ok(wgpu::TextureSampleType::Float { filterable }),
        naga::ScalarKind::Uint => Ok(wgpu::TextureSampleType::Uint),
        naga::ScalarKind::Sint => Ok(wgpu::TextureSampleType::Sint),
        other => Err(format!("sampled textures of {other:?} are not supported")),
    }
}

fn storage_format(f: naga::StorageFormat) -> Option<wgpu::TextureFormat> {
    use naga::StorageFormat as S;
    use wgpu::TextureFormat as T;
    Some(match f {
        S::R32Float => T::R32Float,
        S::Rg32Float => T::Rg32Float,
        S::Rgba32Float => T::Rgba32Float,
        S::Rgba16Float => T::Rgba16Float,
        S::R32Uint => T::R32Uint,
        S::Rg32Uint => T::Rg32Uint,
        S::Rgba32Uint => T::Rgba32Uint,
        S::Rgba8Unorm => T::Rgba8Unorm,
        _ => return None,
    })
}
