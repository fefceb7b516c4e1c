//! Lit rendering of the boundary of a mesh at the current positions.

use super::depth_peeling::attachment;
use super::geometry::Geometry;
use super::image::Image;
use super::image_tiles::draw_supersampled;
use super::sections::Sections;
use super::view::{CameraTransform, ImageRegion, View};
use super::{Camera, TransferFunction};
use crate::gpu::{Array, Draw, Gpu, Pass, Recorder, Texel};
use crate::mesh::LocalFrame;
use crate::{Error, Result};
use std::collections::HashMap;

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Normals {
            pub nodes: u32,
        }
    }
}

/// Normals used for shading a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Shading {
    /// Interpolated node normals.
    #[default]
    Smooth,
    /// Face normals.
    Flat,
}

/// Colour of a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceColour {
    /// Uniform colour: red, green, blue.
    Plain([f32; 3]),
    /// Colour of the transfer function at the scalar of each node.
    Field(TransferFunction),
}

/// Render target of a surface.
pub struct SurfaceTarget<'a> {
    /// Colour attachment; its size is the image size.
    pub colour: &'a wgpu::TextureView,
    /// A `Depth32Float` attachment of the same size, with the depth of
    /// [`Raycaster::file_to_clip`](super::Raycaster::file_to_clip): nearer is larger.
    pub depth: &'a wgpu::TextureView,
    /// Background colour that replaces the content of both attachments; `None` draws over it.
    pub background: Option<[f32; 4]>,
}

impl SurfaceTarget<'_> {
    /// Begins a pass that draws into the target.
    pub(crate) fn begin<'p>(&self, work: &'p mut Recorder, label: &str) -> wgpu::RenderPass<'p> {
        let colour_load = match self.background {
            Some(c) => {
                let [r, g, b, a] = c.map(f64::from);
                wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a })
            }
            None => wgpu::LoadOp::Load,
        };
        let depth_load = match self.background {
            Some(_) => wgpu::LoadOp::Clear(0.0),
            None => wgpu::LoadOp::Load,
        };
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view: self.depth,
            depth_ops: Some(wgpu::Operations {
                load: depth_load,
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        };
        let colour = [attachment(self.colour, colour_load)];
        work.render_pass(label, &colour, Some(depth))
    }
}

/// Renderer of the boundary of a [`Geometry`].
pub struct Surface {
    gpu: Gpu,
    frame: LocalFrame,
    corners: u32,
    nodes: u32,
    positions: Array,
    boundary: Array,
    firsts: Array,
    around: Array,
    normals: Array,
    colours: Array,
    colour: SurfaceColour,
    shading: Shading,
    /// Clip planes.
    clips: ClipPlanes,
    refresh: Pass,
    draws: HashMap<wgpu::TextureFormat, Draw>,
}

/// Clip planes in shader layout, and rest positions if a plane is fixed to the rest configuration.
#[derive(Clone)]
pub(crate) struct ClipPlanes {
    pub count: usize,
    pub planes: Array,
    pub rest_positions: Option<Array>,
}

impl ClipPlanes {
    /// Uploads the clip planes of `inside` in `frame`; `rests` returns the rest positions of nodes
    /// or vertices.
    pub fn new(
        gpu: &Gpu,
        inside: &Sections,
        frame: LocalFrame,
        rests: impl FnOnce() -> Result<Array>,
    ) -> Result<ClipPlanes> {
        inside.check()?;
        let at_rest = inside.clips().any(|p| p.at_rest);
        Ok(ClipPlanes {
            count: inside.clips().count(),
            planes: inside.to_gpu(gpu, frame, |s| s)?,
            rest_positions: at_rest.then(rests).transpose()?,
        })
    }

    /// Returns the rest positions, or a placeholder array if no plane needs them.
    pub fn rests(&self) -> &Array {
        self.rest_positions.as_ref().unwrap_or(&self.planes)
    }

    /// Returns the pipeline constants: the number of planes, and whether any is fixed to the rest
    /// configuration.
    pub fn constants(&self) -> [f64; 2] {
        [
            self.count as f64,
            f64::from(u8::from(self.rest_positions.is_some())),
        ]
    }
}

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Supersampling factor per axis of images in memory.
const SUPERSAMPLING: u32 = 2;

impl Surface {
    /// Creates a renderer of the boundary of `geometry` with the given node `scalars`.
    ///
    /// # Errors
    /// An error if the device cannot allocate the resources.
    pub fn new(
        gpu: &Gpu,
        geometry: &Geometry,
        scalars: &[f64],
        colour: &SurfaceColour,
        shading: Shading,
    ) -> Result<Surface> {
        let nodes = geometry.projected.len();
        let (firsts, around) = faces_around(&geometry.boundary_faces, nodes as usize);
        let firsts = gpu.array_of_with_headroom("first faces", Texel::U32, &firsts)?;
        let around = gpu.array_of_with_headroom("faces around nodes", Texel::U32, &around)?;
        let normals = gpu.array_with_headroom("normals", Texel::F32x4, nodes as usize)?;
        let refresh = refresh_pass(geometry, &firsts, &around, &normals)?;
        let colours = colours(geometry, scalars, colour);
        Ok(Surface {
            gpu: gpu.clone(),
            frame: geometry.frame,
            corners: geometry.corners(),
            nodes,
            positions: geometry.positions.clone(),
            boundary: geometry.boundary.clone(),
            firsts,
            around,
            normals,
            colours: gpu.array_of_with_headroom("colours", Texel::F32x4, &colours)?,
            colour: colour.clone(),
            shading,
            clips: clips(gpu, &Sections::default(), geometry)?,
            refresh,
            draws: HashMap::new(),
        })
    }

    /// Sets the clip planes of `inside` for subsequent images; cut faces are drawn by a
    /// [`Raycaster`](super::Raycaster).
    ///
    /// # Errors
    /// [`Error::Input`] for invalid numbers, or a plane fixed to the rest configuration if
    /// `geometry` does not store rest positions.
    pub fn set_sections(&mut self, inside: &Sections, geometry: &Geometry) -> Result<()> {
        self.clips = clips(&self.gpu, inside, geometry)?;
        self.draws.clear();
        Ok(())
    }

    /// Updates the surface after a cut has been applied to `geometry`. Of `scalars`, only those of
    /// new nodes are read.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of scalars differs from the number of nodes; otherwise as
    /// [`Surface::new`].
    pub fn follow(&mut self, geometry: &Geometry, scalars: &[f64]) -> Result<()> {
        let (gpu, nodes) = (self.gpu.clone(), geometry.projected.len() as usize);
        if scalars.len() != nodes || nodes < self.nodes as usize {
            return Err(Error::Input(format!(
                "number of scalars must equal the number of nodes after the cut, {nodes}, and nodes cannot be removed: got {} scalars for a surface of {} nodes",
                scalars.len(),
                self.nodes
            )));
        }
        let new = colours(geometry, &scalars[self.nodes as usize..], &self.colour);
        let (firsts, around) = faces_around(&geometry.boundary_faces, nodes);
        let mut replaced = geometry.positions.texture() != self.positions.texture();
        replaced |= geometry.boundary.texture() != self.boundary.texture();
        replaced |= gpu.resize(&mut self.colours, "colours", nodes)?;
        replaced |= gpu.resize(&mut self.normals, "normals", nodes)?;
        gpu.write_items(&self.colours, self.nodes, &new)?;
        gpu.resize(&mut self.firsts, "first faces", firsts.len())?;
        gpu.write_array(&self.firsts, &firsts)?;
        gpu.resize(&mut self.around, "faces around nodes", around.len())?;
        gpu.write_array(&self.around, &around)?;
        self.refresh = refresh_pass(geometry, &self.firsts, &self.around, &self.normals)?;
        self.positions = geometry.positions.clone();
        self.boundary = geometry.boundary.clone();
        self.corners = geometry.corners();
        self.nodes = nodes as u32;
        if let Some(rests) = &mut self.clips.rest_positions {
            *rests = geometry.rest_positions().unwrap_or(rests).clone();
            replaced = true;
        }
        if replaced {
            self.draws.clear();
        }
        Ok(())
    }

    /// Sets the node `scalars`, in the current range of `geometry`.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of scalars differs from the number of nodes.
    pub fn set_scalars(&mut self, geometry: &Geometry, scalars: &[f64]) -> Result<()> {
        if scalars.len() != self.nodes as usize {
            return Err(Error::Input(format!(
                "number of scalars must equal the number of nodes, got {} for a surface of {} nodes",
                scalars.len(),
                self.nodes
            )));
        }
        let colours = colours(geometry, scalars, &self.colour);
        self.gpu.write_items(&self.colours, 0, &colours)
    }

    /// Records the drawing of the surface; positions are read when the commands run.
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
        self.record_window(work, camera, target, window)
    }

    /// Returns an antialiased image of `size` pixels. Waits and reads back.
    ///
    /// # Errors
    /// As [`Surface::record`].
    pub fn image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<Image> {
        self.image_of_samples(camera, size, SUPERSAMPLING)
    }

    /// As [`Surface::image`], with `samples` × `samples` samples per pixel.
    pub(crate) fn image_of_samples(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        samples: u32,
    ) -> Result<Image> {
        let gpu = self.gpu.clone();
        image_with_depth(&gpu, size, samples, |work, target, window| {
            self.record_window(work, camera, target, window)
        })
    }

    pub(crate) fn record_window(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        target: &SurfaceTarget,
        window: ImageRegion,
    ) -> Result<()> {
        camera.check()?;
        let view = View {
            nodes: self.nodes,
            corners: self.corners,
            ..CameraTransform::new(camera, &self.frame, window).to_gpu()
        };
        let format = target.colour.texture().format();
        if !self.draws.contains_key(&format) {
            let draw = self.draw(format, &view)?;
            self.draws.insert(format, draw);
        }
        self.refresh.record(work);
        if let Some(draw) = self.draws.get(&format) {
            draw.set_params(work, &view)?;
            let mut pass = target.begin(work, "render/surface");
            draw.record(&mut pass, self.corners, 1);
        }
        Ok(())
    }

    fn draw(&self, format: wgpu::TextureFormat, view: &View) -> Result<Draw> {
        let smooth = self.shading == Shading::Smooth;
        let [clips, resting] = self.clips.constants();
        self.gpu
            .draw("render/surface")
            .constant("SMOOTH", f64::from(u8::from(smooth)))
            .constant("CLIP_PLANE_COUNT", clips)
            .constant("USE_REST_POSITIONS", resting)
            .read(&self.positions)
            .read(&self.boundary)
            .read(&self.normals)
            .read(&self.colours)
            .params(view)
            .read(&self.clips.planes)
            .read(self.clips.rests())
            .target(format, None)
            .depth(DEPTH, wgpu::CompareFunction::Greater, true)
            .build()
    }
}

fn clips(gpu: &Gpu, inside: &Sections, geometry: &Geometry) -> Result<ClipPlanes> {
    ClipPlanes::new(gpu, inside, geometry.frame, || {
        geometry.rest_positions().cloned().ok_or_else(|| {
            Error::Input(
                "the geometry has no rest positions; call Geometry::store_rest_positions first"
                    .into(),
            )
        })
    })
}

fn refresh_pass(
    geometry: &Geometry,
    firsts: &Array,
    around: &Array,
    normals: &Array,
) -> Result<Pass> {
    let nodes = normals.len();
    geometry
        .gpu
        .pass("render/surface_normals")
        .read(&geometry.positions)
        .read(&geometry.boundary)
        .read(firsts)
        .read(around)
        .write(normals)
        .params(&gpu_data::Normals { nodes })
        .dispatch_items(nodes)
}

/// Returns the start of each node's list of boundary faces, with the total length at the end, and
/// the concatenated lists.
fn faces_around(boundary: &[[u32; 4]], nodes: usize) -> (Vec<u32>, Vec<u32>) {
    let mut firsts = vec![0u32; nodes + 1];
    let corners = || {
        boundary
            .iter()
            .enumerate()
            .flat_map(|(f, face)| face[..3].iter().map(move |v| (*v as usize, f as u32)))
    };
    corners().for_each(|(v, _)| firsts[v + 1] += 1);
    for v in 0..nodes {
        firsts[v + 1] += firsts[v];
    }
    let mut next = firsts.clone();
    let mut around = vec![0; 3 * boundary.len()];
    for (v, f) in corners() {
        around[next[v] as usize] = f;
        next[v] += 1;
    }
    (firsts, around)
}

fn colours(geometry: &Geometry, scalars: &[f64], colour: &SurfaceColour) -> Vec<[f32; 4]> {
    match colour {
        SurfaceColour::Plain([r, g, b]) => vec![[*r, *g, *b, 1.0]; scalars.len()],
        SurfaceColour::Field(transfer) => {
            let resolved = transfer.to_absolute(geometry.range, geometry.frame.scale);
            let of = |s: &f64| {
                let [r, g, b] = resolved.colour(*s).map(|c| c as f32);
                [r, g, b, 1.0]
            };
            scalars.iter().map(of).collect()
        }
    }
}

/// Renders an image of `size` pixels on a transparent background, with a depth buffer and `samples` ×
/// `samples` samples per pixel; `draw` records each tile. Waits and reads back.
pub(crate) fn image_with_depth(
    gpu: &Gpu,
    size: [u32; 2],
    samples: u32,
    mut draw: impl FnMut(&mut Recorder, &SurfaceTarget, ImageRegion) -> Result<()>,
) -> Result<Image> {
    let mut depth: Option<wgpu::TextureView> = None;
    draw_supersampled(gpu, size, samples, |colour, window| {
        let depth = match depth.take() {
            Some(kept) => depth.insert(kept),
            None => depth.insert(depth_target(gpu, window.size)?),
        };
        let target = SurfaceTarget {
            colour,
            depth,
            background: Some([0.0; 4]),
        };
        let mut work = gpu.start_recording();
        draw(&mut work, &target, window)?;
        work.submit()
    })
}

/// Creates a depth target of `size` pixels that can also be read.
fn depth_target(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::TextureView> {
    gpu.target(
        "surface depth",
        size,
        DEPTH,
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
    )
}
