//! The lit boundary of a mesh, where its nodes are now.

use super::depth_peeling::attachment;
use super::geometry::Geometry;
use super::image::Image;
use super::image_tiles::draw_in_tiles;
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

/// Which normals a surface is lit by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Shading {
    /// Normals of the nodes, interpolated.
    #[default]
    Smooth,
    /// Normals of the faces.
    Flat,
}

/// What colours a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceColour {
    /// One colour: red, green, blue.
    Plain([f32; 3]),
    /// The transfer function's colour of each node's scalar.
    Field(TransferFunction),
}

/// Where a surface is drawn.
pub struct SurfaceTarget<'a> {
    /// The colour attachment; its texture's size is the picture's.
    pub colour: &'a wgpu::TextureView,
    /// A `Depth32Float` attachment of the same size, in the depths of
    /// [`Raycaster::file_to_clip`](super::Raycaster::file_to_clip): nearer is larger.
    pub depth: &'a wgpu::TextureView,
    /// Replaces what was in both; without it they are drawn over.
    pub background: Option<[f32; 4]>,
}

/// Draws the boundary of a [`Geometry`].
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
    /// What planes leave of it.
    clips: ClipPlanes,
    refresh: Pass,
    draws: HashMap<wgpu::TextureFormat, Draw>,
}

/// Clip planes as shaders read them, and where the nodes rest, if any is given there.
#[derive(Clone)]
pub(crate) struct ClipPlanes {
    pub count: usize,
    pub planes: Array,
    pub rest_positions: Option<Array>,
}

impl ClipPlanes {
    /// Those of `inside`, in `frame`; `rests` gives where nodes or vertices rest.
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

    /// Where nodes rest; anything of the kind, where no plane asks.
    pub fn rests(&self) -> &Array {
        self.rest_positions.as_ref().unwrap_or(&self.planes)
    }

    /// As the shaders' overrides: the number of planes, and whether any is given at rest.
    pub fn constants(&self) -> [f64; 2] {
        [
            self.count as f64,
            f64::from(u8::from(self.rest_positions.is_some())),
        ]
    }
}

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Pictures in memory are drawn so many times larger each way, and averaged.
const SUPERSAMPLING: u32 = 2;

impl Surface {
    /// Prepares to draw the boundary of `geometry`, whose nodes have the given `scalars`.
    ///
    /// # Errors
    /// When the device cannot hold what it needs.
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

    /// Draws from now on what the clip planes of `inside` leave of it; the cut faces are for a
    /// [`Raycaster`](super::Raycaster) to draw.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that make no sense, or a plane given at rest where `geometry`
    /// does not remember that.
    pub fn set_sections(&mut self, inside: &Sections, geometry: &Geometry) -> Result<()> {
        self.clips = clips(&self.gpu, inside, geometry)?;
        self.draws.clear();
        Ok(())
    }

    /// Takes over what a cut has made of `geometry`, after that has followed it. Of `scalars` only
    /// the new nodes' are looked at.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of scalars than nodes; otherwise as [`Surface::new`].
    pub fn follow(&mut self, geometry: &Geometry, scalars: &[f64]) -> Result<()> {
        let (gpu, nodes) = (self.gpu.clone(), geometry.projected.len() as usize);
        if scalars.len() != nodes || nodes < self.nodes as usize {
            return Err(Error::Input(format!(
                "{} scalars given for a surface of {} nodes, to follow a cut that left {nodes}",
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

    /// Colours the nodes by other `scalars`, in the range that `geometry` has now.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of them.
    pub fn set_scalars(&mut self, geometry: &Geometry, scalars: &[f64]) -> Result<()> {
        if scalars.len() != self.nodes as usize {
            return Err(Error::Input(format!(
                "{} scalars given for a surface of {} nodes",
                scalars.len(),
                self.nodes
            )));
        }
        let colours = colours(geometry, scalars, &self.colour);
        self.gpu.write_items(&self.colours, 0, &colours)
    }

    /// Records the drawing of the surface, at the positions of that moment.
    ///
    /// # Errors
    /// For a bad camera, or when the device refuses.
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

    /// The picture of `camera`, of `size` pixels, its edges smoothed. Waits and reads back.
    ///
    /// # Errors
    /// As [`Surface::record`].
    pub fn image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<Image> {
        self.image_of_samples(camera, size, SUPERSAMPLING)
    }

    /// As [`Surface::image`], drawn `samples` times larger each way and averaged.
    pub(crate) fn image_of_samples(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        samples: u32,
    ) -> Result<Image> {
        let gpu = self.gpu.clone();
        let fine = size.map(|n| n.saturating_mul(samples));
        let mut depth: Option<wgpu::TextureView> = None;
        let pixels = draw_in_tiles(&gpu, fine, |colour, window| {
            let depth = match depth.take() {
                Some(kept) => depth.insert(kept),
                None => depth.insert(depth_target(&gpu, window.size)?),
            };
            let target = SurfaceTarget {
                colour,
                depth,
                background: Some([0.0; 4]),
            };
            let mut work = gpu.start_recording();
            self.record_window(&mut work, camera, &target, window)?;
            work.submit()
        })?;
        Ok(Image {
            size,
            channels: 4,
            values: downsampled(&pixels, size, samples),
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
            let colour_load = match target.background {
                Some(c) => {
                    let [r, g, b, a] = c.map(f64::from);
                    wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a })
                }
                None => wgpu::LoadOp::Load,
            };
            let depth_load = match target.background {
                Some(_) => wgpu::LoadOp::Clear(0.0),
                None => wgpu::LoadOp::Load,
            };
            let depth = wgpu::RenderPassDepthStencilAttachment {
                view: target.depth,
                depth_ops: Some(wgpu::Operations {
                    load: depth_load,
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            };
            let colour = [attachment(target.colour, colour_load)];
            let mut pass = work.render_pass("render/surface", &colour, Some(depth));
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
                "the geometry does not know where it rests; call Geometry::remember_rest first"
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

/// For each node where its boundary faces begin in the list of them, one entry more at the end;
/// and the list.
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

/// A target for depths of `size` pixels, which can also be read.
pub(crate) fn depth_target(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::TextureView> {
    gpu.target(
        "surface depth",
        size,
        DEPTH,
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
    )
}

/// Averages the samples of each pixel of a picture of `size`, `samples` each way.
pub(crate) fn downsampled(fine: &[[f32; 4]], size: [u32; 2], samples: u32) -> Vec<f32> {
    let (n, width) = (samples as usize, size[0] as usize);
    let pixel = |i: usize| {
        let (x, y) = (i % width * n, i / width * n);
        let mut sum = [0.0; 4];
        for (dy, dx) in (0..n).flat_map(|dy| (0..n).map(move |dx| (dy, dx))) {
            let sample = fine[(y + dy) * width * n + x + dx];
            sum.iter_mut().zip(sample).for_each(|(s, v)| *s += v);
        }
        sum.map(|s| s / (n * n) as f32)
    };
    (0..width * size[1] as usize).flat_map(pixel).collect()
}
