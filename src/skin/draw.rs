//! Renders a skin at the current node positions.

use super::base::SkinBase;
use super::binder::bind_to_node;
use super::binding::{BindingReport, Mapping, vertex_texels};
use super::cut::TriangleKey;
use super::gpu_culling::Cull;
use super::level_of_detail::Level;
use super::report::SkinReport;
use super::vertices::{Vertices, check};
use crate::gpu::{Array, Draw, Gpu, Recorder, Texel};
use crate::mesh::{Field, SurfaceDescription, TriMesh};
use crate::physics::Simulator;
use crate::render::{
    Camera, CameraTransform, ClipPlanes, Image, ImageRegion, Sections, SurfaceTarget,
    image_with_depth, local_positions,
};
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};
use glam::DVec3;
use std::collections::{HashMap, HashSet};

mod gpu_data {
    use crate::render::View;
    crate::gpu_struct! {
        pub(super) struct SkinParams {
            pub view: View,
            pub opacity: f32,
            pub parallax_depth: f32,
            pub _pad: [u32; 2],
        }
    }
}

/// A surface bound to the nodes of a body.
pub struct Skin {
    pub(super) gpu: Gpu,
    pub(super) carrier: SkinBase,
    pub(super) vertices: Vertices,
    pub(super) bound: Vec<VertexBinding>,
    pub(super) report: SkinReport,
    pub(super) scalars: Vec<Field>,
    pub(super) mapping: Mapping,
    /// Whether each triangle is visible.
    pub(super) visible: Vec<bool>,
    /// Whether the skin is the surface of the body itself.
    pub(super) is_body_surface: bool,
    /// Base triangles before the first cut, identified by rest positions; `None` before a cut.
    pub(super) uncut_triangles: Option<HashSet<TriangleKey>>,
    /// Bindings at other levels; `None` for the active level.
    pub(super) levels: Vec<Option<Level>>,
    pub(super) level: usize,
    pub(super) records: Array,
    uvs: Array,
    pub(super) colours: Array,
    pub(super) indices: wgpu::Buffer,
    pub(super) corners: u32,
    pub(super) opacity: f32,
    pub(super) normal_map: Option<wgpu::TextureView>,
    pub(super) height_map: Option<(wgpu::TextureView, f32)>,
    no_map: wgpu::TextureView,
    no_depth: wgpu::TextureView,
    sampler: wgpu::Sampler,
    /// Sections, and the clip planes derived from them.
    pub(super) inside: Sections,
    clips: ClipPlanes,
    pub(super) draws: HashMap<Variant, Draw>,
    pub(super) culling: bool,
    /// Built for the current base and visible triangles.
    pub(super) cull: Option<Cull>,
}

/// Key of a cached draw.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Variant {
    format: wgpu::TextureFormat,
    blended: bool,
    nearer: Option<wgpu::TextureView>,
}

/// Blending and depth options of a skin.
#[derive(Clone, Copy, Default)]
pub(super) struct BlendMode<'a> {
    /// Depth peeling: draws only fragments behind these depths.
    pub behind: Option<&'a wgpu::TextureView>,
    /// Whether to blend over the target without writing depth.
    pub blended: bool,
}

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Supersampling factor per axis for images read back to memory.
const SAMPLES: u32 = 2;
/// Default colour.
const DEFAULT_COLOUR: [f32; 3] = [0.85, 0.62, 0.53];
/// Maximum number of cached draws: their targets come and go.
const KEPT_DRAWS: usize = 32;

impl Skin {
    /// Binds `surface` to `carrier` at rest, both in file coordinates. Orients the triangles
    /// consistently first; holes are allowed and reported.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a surface that cannot be drawn, [`Error::Input`] for a base without
    /// triangles, [`Error::Gpu`] if the device cannot allocate it.
    pub fn new(gpu: &Gpu, surface: &TriMesh, carrier: &SkinBase, mapping: Mapping) -> Result<Skin> {
        check(surface)?;
        let mut surface = surface.clone();
        let turned = surface.orient_consistently();
        let vertices = Vertices::new(&surface)?;
        let (bound, binding) = carrier
            .rest_mesh()
            .bind(&vertices, &carrier.frame, mapping)?;
        let description = SurfaceDescription::new(&surface);
        let report = SkinReport::new(&description, bound.len(), turned, binding);
        Skin::assemble(
            gpu,
            carrier,
            mapping,
            vertices,
            bound,
            report,
            surface.fields,
        )
    }

    /// Binds `surface` to the boundary of `body`, which is at rest, with [`Mapping::Auto`].
    ///
    /// # Errors
    /// As [`Skin::new`].
    pub fn for_body(gpu: &Gpu, surface: &TriMesh, body: &dyn Simulator) -> Result<Skin> {
        Skin::new(
            gpu,
            surface,
            &SkinBase::from_body(gpu, body)?,
            Mapping::Auto,
        )
    }

    /// Creates a skin from the body's own surface or a part of it, with every vertex on its node.
    /// For a body without a skin, and for the walls of cuts. `triangles` index the nodes of the
    /// base; `None` for all base triangles.
    ///
    /// # Errors
    /// As [`Skin::new`].
    pub fn body_surface(
        gpu: &Gpu,
        carrier: &SkinBase,
        triangles: Option<&[[u32; 3]]>,
    ) -> Result<Skin> {
        let base = carrier.rest_mesh();
        let triangles = triangles.unwrap_or(base.triangles);
        let place = |p: &DVec3| carrier.frame.to_file(p.as_vec3());
        let surface = TriMesh {
            vertices: base.nodes.iter().map(place).collect(),
            triangles: triangles.to_vec(),
            ..TriMesh::default()
        };
        check(&surface)?;
        let vertices = Vertices::new(&surface)?;
        // One incident triangle of each node, rotated to start at it.
        let mut own = vec![[0; 3]; surface.vertices.len()];
        for t in triangles {
            (0..3).for_each(|k| own[t[k] as usize] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]);
        }
        let sources = vertices.sources.iter();
        let bound: Vec<VertexBinding> = sources.map(|v| bind_to_node(own[*v as usize])).collect();
        let report = SkinReport::new(
            &SurfaceDescription::new(&surface),
            bound.len(),
            0,
            BindingReport {
                one_to_one: bound.len(),
                ..BindingReport::default()
            },
        );
        let mapping = Mapping::OneToOne;
        let bare = Skin::assemble(gpu, carrier, mapping, vertices, bound, report, Vec::new())?;
        Ok(Skin {
            is_body_surface: true,
            ..bare
        })
    }

    fn assemble(
        gpu: &Gpu,
        carrier: &SkinBase,
        mapping: Mapping,
        vertices: Vertices,
        bound: Vec<VertexBinding>,
        report: SkinReport,
        scalars: Vec<Field>,
    ) -> Result<Skin> {
        let records = vertex_texels(&bound, &vertices);
        let uvs: Vec<[f32; 2]> = match vertices.uvs.is_empty() {
            true => vec![[0.0; 2]; bound.len()],
            false => vertices
                .uvs
                .iter()
                .map(|uv| uv.as_vec2().to_array())
                .collect(),
        };
        let indices = vertices.triangles.as_flattened();
        let [r, g, b] = DEFAULT_COLOUR;
        let nothing =
            |format, label| gpu.target(label, [1, 1], format, wgpu::TextureUsages::TEXTURE_BINDING);
        Ok(Skin {
            gpu: gpu.clone(),
            carrier: carrier.clone(),
            report,
            records: gpu.array_of("skin vertices", Texel::U32x4, &records)?,
            uvs: gpu.array_of("texture coordinates", Texel::F32x2, &uvs)?,
            colours: gpu.array_of(
                "skin colours",
                Texel::F32x4,
                &vec![[r, g, b, 1.0]; bound.len()],
            )?,
            indices: gpu.buffer_of("skin triangles", indices)?,
            corners: indices.len() as u32,
            scalars,
            mapping,
            is_body_surface: false,
            uncut_triangles: None,
            levels: vec![None],
            level: 0,
            visible: vec![true; vertices.triangles.len()],
            vertices,
            bound,
            opacity: 1.0,
            normal_map: None,
            height_map: None,
            no_map: nothing(wgpu::TextureFormat::Rgba8Unorm, "no map")?,
            no_depth: nothing(DEPTH, "no depths")?,
            sampler: gpu.device().create_sampler(&wgpu::SamplerDescriptor {
                label: Some("maps of skins"),
                address_mode_u: wgpu::AddressMode::Repeat,
                address_mode_v: wgpu::AddressMode::Repeat,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            inside: Sections::default(),
            clips: ClipPlanes::new(gpu, &Sections::default(), carrier.frame, || {
                gpu.array("rests of a skin", Texel::F32x4, 1)
            })?,
            draws: HashMap::new(),
            culling: false,
            cull: None,
        })
    }

    /// Clips the skin by the clip planes of `inside`.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid planes; [`Error::Gpu`] if the device cannot allocate the rest
    /// positions.
    pub fn set_sections(&mut self, inside: &Sections) -> Result<()> {
        let frame = self.carrier.frame;
        self.clips = ClipPlanes::new(&self.gpu, inside, frame, || {
            local_positions(&self.gpu, &frame, &self.vertices.positions)
        })?;
        self.inside = inside.clone();
        self.draws.clear();
        Ok(())
    }

    /// Returns statistics of the surface and its binding.
    pub fn report(&self) -> &SkinReport {
        &self.report
    }

    /// Returns statistics of the binding.
    pub fn binding(&self) -> &BindingReport {
        &self.report.binding
    }

    /// Returns the drawn vertices at rest.
    pub fn rest(&self) -> &Vertices {
        &self.vertices
    }

    /// Returns the bindings of the vertices.
    pub fn bound(&self) -> &[VertexBinding] {
        &self.bound
    }

    /// Returns the base mesh.
    pub fn carrier(&self) -> &SkinBase {
        &self.carrier
    }

    /// Sets the visibility of each triangle of the surface, one entry a triangle; for holes that
    /// open during a simulation.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of entries; [`Error::Gpu`] if the device cannot allocate
    /// the list.
    pub fn set_visible_triangles(&mut self, shown: &[bool]) -> Result<()> {
        if shown.len() != self.vertices.triangles.len() {
            return Err(Error::Input(format!(
                "number of visibility entries must equal the number of triangles, got {} for {}",
                shown.len(),
                self.vertices.triangles.len()
            )));
        }
        self.visible.copy_from_slice(shown);
        let kept = self.shown_triangles().into_flattened();
        self.corners = kept.len() as u32;
        self.cull = None;
        if !kept.is_empty() {
            // A new buffer, because images that are recorded but not yet submitted still use the
            // old one.
            self.indices = self.gpu.buffer_of("skin triangles", &kept)?;
        }
        Ok(())
    }

    /// Records the rendering of the skin at the node positions at execution time. An opaque skin
    /// writes depth, which can terminate the rays of a [`Raycaster`](crate::render::Raycaster) of
    /// the same frame; a translucent one is blended over the target, its triangles in file order,
    /// and writes no depth (see [`Compositor`](super::Compositor) for order-correct blending).
    ///
    /// # Errors
    /// An error for an invalid camera, or if the device fails.
    pub fn record(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        target: &SurfaceTarget,
    ) -> Result<()> {
        let texture = target.colour.texture();
        let window = ImageRegion::full([texture.width(), texture.height()]);
        self.carrier.record_normals(work);
        let how = BlendMode {
            blended: self.opacity < 1.0,
            ..BlendMode::default()
        };
        self.record_window(work, camera, target, window, how)
    }

    /// Renders the image of `camera` at `size` pixels, anti-aliased. Waits and reads back.
    ///
    /// # Errors
    /// As [`Skin::record`].
    pub fn image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<Image> {
        let gpu = self.gpu.clone();
        image_with_depth(&gpu, size, SAMPLES, |work, target, window| {
            self.carrier.record_normals(work);
            // Not every device can blend 32-bit float targets: draws the nearest layer only.
            self.record_window(work, camera, target, window, BlendMode::default())
        })
    }

    /// Records the rendering of an image region; the node normals must be up to date.
    pub(super) fn record_window(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        target: &SurfaceTarget,
        window: ImageRegion,
        how: BlendMode,
    ) -> Result<()> {
        camera.check()?;
        let params = gpu_data::SkinParams {
            view: CameraTransform::new(camera, &self.carrier.frame, window).to_gpu(),
            opacity: self.opacity,
            parallax_depth: self.height_map.as_ref().map_or(0.0, |h| h.1),
            _pad: [0; 2],
        };
        let variant = Variant {
            format: target.colour.texture().format(),
            blended: how.blended,
            nearer: how.behind.cloned(),
        };
        if !self.draws.contains_key(&variant) {
            if self.draws.len() >= KEPT_DRAWS {
                self.draws.clear();
            }
            let draw = self.draw(&variant, &params)?;
            self.draws.insert(variant.clone(), draw);
        }
        let culls = self.culling && self.opacity >= 1.0 && how.behind.is_none();
        self.record_cull(work, params.view, culls && self.corners > 0)?;
        let Some(draw) = self.draws.get(&variant) else {
            return Ok(());
        };
        draw.set_params(work, &params)?;
        let cull = self.cull.as_ref();
        let mut pass = target.begin(work, "skin/draw");
        match cull {
            Some(cull) => draw.record_indexed_indirect(&mut pass, &cull.drawn, &cull.arguments),
            None if self.corners == 0 => {}
            None => draw.record_indexed(&mut pass, &self.indices, self.corners),
        }
        Ok(())
    }

    /// Returns the visibility of each triangle of the surface.
    pub fn shown(&self) -> &[bool] {
        &self.visible
    }

    fn draw(&self, variant: &Variant, params: &gpu_data::SkinParams) -> Result<Draw> {
        let flag = |on: bool| f64::from(u8::from(on));
        let over = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
        let height_map = self.height_map.as_ref().map(|h| &h.0);
        let [clips, resting] = self.clips.constants();
        self.gpu
            .draw("skin/draw")
            .constant("NORMAL_MAP", flag(self.normal_map.is_some()))
            .constant("HEIGHT_MAP", flag(height_map.is_some()))
            .constant("DEPTH_PEELED", flag(variant.nearer.is_some()))
            .constant("CLIP_PLANE_COUNT", clips)
            .constant("USE_REST_POSITIONS", resting)
            .read(&self.carrier.positions)
            .read(&self.carrier.normals)
            .read(&self.records)
            .read(&self.uvs)
            .read(&self.colours)
            .read(self.normal_map.as_ref().unwrap_or(&self.no_map))
            .read(height_map.unwrap_or(&self.no_map))
            .read(&self.sampler)
            .read(variant.nearer.as_ref().unwrap_or(&self.no_depth))
            .params(params)
            .read(&self.clips.planes)
            .read(self.clips.rests())
            .target(variant.format, variant.blended.then_some(over))
            .depth(DEPTH, wgpu::CompareFunction::Greater, !variant.blended)
            .build()
    }
}
