//! Seeing inside a mesh while it moves: the single-pass raycaster.
//!
//! A start pass rasterises the boundary and writes the tet and face where each pixel's ray enters;
//! a fullscreen fragment pass walks the ray from tet to tet to where it leaves, and composites
//! front to back ([`Walk`] names the two ways to walk). Rays that enter again are peeled off layer
//! by layer ([`super::peel`]). Segments are looked up in a pre-integrated table
//! ([`super::table`]). Nothing is read back to decide anything.

use super::geometry::Geometry;
use super::image::Image;
use super::peel::{Peel, SUM, Walks, attachment};
use super::table::{TABLE_SIZES, Table, TableForm, TableTexel, Wanted};
use super::tiles::{check_size, draw_in_tiles};
use super::view::{LocalView, View, Window};
use super::{Camera, ResolvedTransfer, TransferFunction};
use crate::gpu::{Draw, Gpu, Recorder, Texel};
use crate::{Error, Result};
use std::collections::HashMap;

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Resolve {
            pub background: [f32; 4],
            pub layers: u32,
            pub _pad: [u32; 3],
        }
    }
}

/// How a ray finds its way from tet to tet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Walk {
    /// Three projected vertices carried along, one fetched a step: faster, and right also where
    /// a tet is inverted.
    #[default]
    Vertices,
    /// The paper's: the nearest plane ahead, and the scalar from the gradient.
    Planes,
}

/// What a ray gathers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// Emission and absorption by the transfer function.
    #[default]
    Composite,
    /// Length inside the mesh, in file units.
    Thickness,
}

/// What the shaders can gather: [`Mode`], or counts for a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Gathered {
    Composite,
    Thickness,
    Statistics,
}

impl From<Mode> for Gathered {
    fn from(mode: Mode) -> Gathered {
        match mode {
            Mode::Composite => Gathered::Composite,
            Mode::Thickness => Gathered::Thickness,
        }
    }
}

/// Choices that a raycaster is made with; see [`RaycastOptions::within`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaycastOptions {
    /// How rays walk.
    pub walk: Walk,
    /// How segments are looked up.
    pub table: TableForm,
    /// What the table's values are held in.
    pub texel: TableTexel,
    /// Texels of the table along each scalar, and layers of a [`TableForm::Volume`]; chosen for
    /// `accuracy` where nothing is said.
    pub table_size: Option<u32>,
    /// A ray of more than this opacity is not followed further; 1 follows each to its end.
    pub opaque: f64,
    /// Most times a ray may enter the mesh (`--layers`).
    pub layers: u32,
    /// Error of a picture's values that the table's size is chosen for.
    pub accuracy: f64,
}

impl RaycastOptions {
    fn check(&self, gpu: &Gpu) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        if !(1..=255).contains(&self.layers) {
            return wrong(format!(
                "{} layers: choose from 1 to 255 (--layers)",
                self.layers
            ));
        }
        if !(self.opaque > 0.0 && self.opaque <= 1.0) {
            return wrong(format!(
                "rays cannot end at an opacity of {}: choose above 0, and up to 1",
                self.opaque
            ));
        }
        if !(self.accuracy > 0.0 && self.accuracy.is_finite()) {
            return wrong(format!(
                "an accuracy of {} cannot be met: choose above 0, of a range from 0 to 1",
                self.accuracy
            ));
        }
        self.table.check()?;
        self.texel.check(gpu)?;
        match self.table_size {
            Some(size) if !TABLE_SIZES.contains(&size) => wrong(format!(
                "a table of {size} texels a side: choose from {} to {}",
                TABLE_SIZES.start(),
                TABLE_SIZES.end()
            )),
            _ => Ok(()),
        }
    }
}

/// Where a picture is drawn.
pub struct Target<'a> {
    /// The colour attachment; its texture's size is the picture's.
    pub colour: &'a wgpu::TextureView,
    /// Depths (`Depth32Float`, drawn with [`Raycaster::clip_from_file`]) of opaque things that
    /// hide what lies behind them.
    pub occluder: Option<&'a wgpu::TextureView>,
    /// What was there before is replaced by this colour (red, green, blue, opacity) under the
    /// picture; without one, the picture is blended over it.
    pub background: Option<[f32; 4]>,
}

/// What the rays of a picture met.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RaycastReport {
    /// Pixels whose ray meets the mesh.
    pub rays: u64,
    /// Walks that ended neither at the boundary nor opaque; none, unless tets are inverted.
    pub lost_rays: u64,
    /// Tets that a ray passes, on average.
    pub tets_per_ray: f64,
    /// Most times a ray enters the mesh.
    pub peel_layers: u32,
    /// Tets that are inside out or flat.
    pub inverted: u32,
}

/// A walk is given up after this many tets beyond those there are.
const CAP_SLACK: u32 = 16;

/// Draws the inside of a [`Geometry`].
pub struct Raycaster {
    gpu: Gpu,
    geometry: Geometry,
    options: RaycastOptions,
    transfer: TransferFunction,
    table: Table,
    sampler: wgpu::Sampler,
    lost: wgpu::Buffer,
    nothing_opaque: wgpu::TextureView,
    frame: Option<Frame>,
}

/// What is made for one size of picture.
struct Frame {
    /// Of the geometry that it was made for.
    generation: u64,
    peel: Peel,
    walks: HashMap<(Gathered, bool), Walks>,
    /// The occluder that the walks were prepared with.
    occluder: Option<wgpu::TextureView>,
    resolves: HashMap<(wgpu::TextureFormat, bool), Draw>,
}

impl Raycaster {
    /// A raycaster for `geometry`, with the default [`RaycastOptions`].
    ///
    /// # Errors
    /// When the device cannot hold what it needs.
    pub fn new(gpu: &Gpu, geometry: Geometry, transfer: &TransferFunction) -> Result<Raycaster> {
        Raycaster::with_options(gpu, geometry, transfer, RaycastOptions::default())
    }

    /// A raycaster for `geometry`.
    ///
    /// # Errors
    /// As [`Raycaster::new`]; [`Error::Input`] for options out of their range.
    pub fn with_options(
        gpu: &Gpu,
        geometry: Geometry,
        transfer: &TransferFunction,
        options: RaycastOptions,
    ) -> Result<Raycaster> {
        options.check(gpu)?;
        let table = make_table(gpu, &geometry, transfer, &options)?;
        let sampler = gpu.device().create_sampler(&wgpu::SamplerDescriptor {
            label: Some("table"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let nothing = gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("nothing opaque"),
            size: wgpu::Extent3d::default(),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Depth32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        Ok(Raycaster {
            gpu: gpu.clone(),
            geometry,
            options,
            transfer: transfer.clone(),
            table,
            sampler,
            lost: gpu.buffer("lost rays", 4)?,
            nothing_opaque: nothing.create_view(&wgpu::TextureViewDescriptor::default()),
            frame: None,
        })
    }

    /// What it draws.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// What it draws, to be told that it [`moved`](Geometry::moved).
    pub fn geometry_mut(&mut self) -> &mut Geometry {
        &mut self.geometry
    }

    /// The transfer function, in absolute terms.
    pub fn transfer(&self) -> ResolvedTransfer {
        self.transfer
            .resolved(self.geometry.range, self.geometry.frame.scale)
    }

    /// Draws with another transfer function from now on; its table is built on the GPU, in the
    /// next picture's recording.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        self.table = make_table(&self.gpu, &self.geometry, transfer, &self.options)?;
        self.transfer = transfer.clone();
        if let Some(frame) = &mut self.frame {
            frame.walks.clear();
        }
        Ok(())
    }

    /// How it draws.
    pub fn options(&self) -> &RaycastOptions {
        &self.options
    }

    /// Texels of the table along each scalar.
    pub fn table_size(&self) -> u32 {
        self.table.size
    }

    /// Layers of the table: its slices, or the depths of a [`TableForm::Volume`].
    pub fn table_layers(&self) -> u32 {
        self.table.layers
    }

    /// Draws with other options from now on.
    ///
    /// # Errors
    /// As [`Raycaster::with_options`]; the old ones stay.
    pub fn set_options(&mut self, options: RaycastOptions) -> Result<()> {
        options.check(&self.gpu)?;
        self.table = make_table(&self.gpu, &self.geometry, &self.transfer, &options)?;
        self.options = options;
        self.frame = None;
        Ok(())
    }

    /// The matrix from file coordinates to the clip space of `camera`, whose depth falls from 1
    /// near the eye to 0: for drawing an occluder.
    pub fn clip_from_file(&self, camera: &Camera, size: [u32; 2]) -> glam::DMat4 {
        let frame = &self.geometry.frame;
        LocalView::new(camera, frame, Window::whole(size)).clip_from_file(frame)
    }

    /// Records the drawing of a picture into `target`. Refreshes what the positions have changed
    /// and builds the table first where needed; reads nothing back.
    ///
    /// # Errors
    /// [`Error::Input`] for a bad camera, [`Error::Gpu`] when the device refuses.
    pub fn record(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        mode: Mode,
        target: &Target,
    ) -> Result<()> {
        let texture = target.colour.texture();
        let window = Window::whole([texture.width(), texture.height()]);
        self.record_window(work, camera, mode.into(), target, window)
    }

    /// As [`Raycaster::record`], for a part of a picture.
    pub(crate) fn record_part(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        mode: Mode,
        target: &Target,
        window: Window,
    ) -> Result<()> {
        self.record_window(work, camera, mode.into(), target, window)
    }

    /// The picture of `camera`, of `size` pixels. Waits and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::record`]; and [`Error::Input`] when a ray enters more often than there are
    /// layers for.
    pub fn image(&mut self, camera: &Camera, size: [u32; 2], mode: Mode) -> Result<Image> {
        let (pixels, layers) = self.gather(camera, size, mode.into())?;
        self.check_layers(layers)?;
        let (channels, values) = match mode {
            Mode::Composite => (4, pixels.into_iter().flatten().collect()),
            Mode::Thickness => (1, pixels.into_iter().map(|p| p[0]).collect()),
        };
        Ok(Image {
            size,
            channels,
            values,
        })
    }

    /// What the rays of a picture meet, at the present positions. Draws it once more, whole rays,
    /// and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn report(&mut self, camera: &Camera, size: [u32; 2]) -> Result<RaycastReport> {
        self.gpu.queue().write_buffer(&self.lost, 0, &[0; 4]);
        let (pixels, layers) = self.gather(camera, size, Gathered::Statistics)?;
        let lost = self.gpu.read_buffer::<u32>(&self.lost)?;
        self.check_layers(layers)?;
        let rays = pixels.iter().filter(|p| p[1] > 0.0).count() as u64;
        let steps: f64 = pixels.iter().map(|p| f64::from(p[0])).sum();
        Ok(RaycastReport {
            rays,
            lost_rays: lost.first().copied().unwrap_or(0).into(),
            tets_per_ray: steps / (rays.max(1) as f64),
            peel_layers: layers,
            inverted: self.geometry.inverted()?,
        })
    }

    /// What the table gives for `segments` (scalar in front, scalar behind, length; file units):
    /// colour premultiplied by opacity, and opacity. To be held against
    /// [`segment_integral`](crate::reference::segment_integral). Waits and reads back.
    ///
    /// # Errors
    /// When the device cannot hold them.
    pub fn look_up(&mut self, segments: &[[f64; 3]]) -> Result<Vec<[f32; 4]>> {
        let (low, high) = self.geometry.range;
        let share = |s: f64| ((s - low) / (high - low)) as f32;
        let scale = self.geometry.frame.scale;
        let given: Vec<[f32; 4]> = segments
            .iter()
            .map(|[front, back, d]| [share(*front), share(*back), (d / scale) as f32, 0.0])
            .collect();
        let given = self.gpu.array_of("segments", Texel::F32x4, &given)?;
        let found = self.gpu.array("looked up", Texel::F32x4, segments.len())?;
        let view = View {
            scalar: self.table.scalar(),
            opacity: self.table.opacity,
            nodes: given.len(),
            layers: self.table.layers,
            reach: self.table.reach,
            ..bytemuck::Zeroable::zeroed()
        };
        let pass = self
            .gpu
            .pass("render/look_up")
            .constant("TABLE", self.options.table.code())
            .constant("SAMPLES", self.options.table.samples())
            .constant("OPAQUE", self.options.opaque)
            .read(&given)
            .read(&self.table.view)
            .read(&self.sampler)
            .write(&found)
            .params(&view)
            .over(given.len())?;
        let mut work = self.gpu.record();
        self.table.record(&mut work);
        pass.record(&mut work);
        work.submit()?;
        self.gpu.read_array(&found)
    }

    fn check_layers(&self, found: u32) -> Result<()> {
        if found > self.options.layers {
            return Err(Error::Input(format!(
                "a ray enters the mesh more than {0} times, and {0} layers were allowed; allow more with --layers",
                self.options.layers
            )));
        }
        Ok(())
    }

    /// All pixels of a picture, and the most layers that a tile needed.
    fn gather(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        gathered: Gathered,
    ) -> Result<(Vec<[f32; 4]>, u32)> {
        let gpu = self.gpu.clone();
        let mut layers = 0;
        let pixels = draw_in_tiles(&gpu, size, |colour, window| {
            let target = Target {
                colour,
                occluder: None,
                background: Some([0.0; 4]),
            };
            let mut work = gpu.record();
            self.record_window(&mut work, camera, gathered, &target, window)?;
            work.submit()?;
            if let Some(frame) = &self.frame {
                layers = layers.max(frame.peel.layers_found(&gpu)?);
            }
            Ok(())
        })?;
        Ok((pixels, layers))
    }

    fn record_window(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        gathered: Gathered,
        target: &Target,
        window: Window,
    ) -> Result<()> {
        camera.check()?;
        let view = self.view(camera, window);
        self.table.record(work);
        if self.options.walk == Walk::Planes {
            self.geometry.record_refresh(work);
        }
        check_size(window.size)?;
        // The frame is out of `self` while draws are prepared from the rest of it.
        let generation = self.geometry.generation;
        let fits = |f: &Frame| f.peel.size == window.size && f.generation == generation;
        let kept = self.frame.take().filter(fits);
        let mut frame = match kept {
            Some(frame) => frame,
            None => Frame {
                generation,
                peel: Peel::new(&self.geometry, &view, window.size, self.options.layers)?,
                walks: HashMap::new(),
                occluder: None,
                resolves: HashMap::new(),
            },
        };
        let drawn = self.draw(work, &mut frame, &view, gathered, target);
        self.frame = Some(frame);
        drawn
    }

    fn draw(
        &self,
        work: &mut Recorder,
        frame: &mut Frame,
        view: &View,
        gathered: Gathered,
        target: &Target,
    ) -> Result<()> {
        if frame.occluder.as_ref() != target.occluder {
            frame.walks.retain(|(_, occluded), _| !occluded);
            frame.occluder = target.occluder.cloned();
        }
        let key = (gathered, target.occluder.is_some());
        if !frame.walks.contains_key(&key) {
            let walks = self.walks(&frame.peel, view, gathered, target.occluder)?;
            frame.walks.insert(key, walks);
        }
        if let Some(walks) = frame.walks.get(&key) {
            frame.peel.record(&self.gpu, work, walks, view);
        }
        self.resolve(work, frame, target)
    }

    /// Brings the sum of the last layer that ran into the target.
    fn resolve(&self, work: &mut Recorder, frame: &mut Frame, target: &Target) -> Result<()> {
        let params = gpu_data::Resolve {
            background: target.background.unwrap_or_default(),
            layers: frame.peel.layers,
            _pad: [0; 3],
        };
        let format = target.colour.texture().format();
        let blend = target.background.is_none();
        let key = (format, blend);
        if !frame.resolves.contains_key(&key) {
            let peel = &frame.peel;
            let over = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
            let draw = self
                .gpu
                .draw("render/resolve")
                .read(&peel.sums[0])
                .read(&peel.sums[1])
                .read(&peel.arguments[0])
                .read(&peel.arguments[1])
                .params(&params)
                .target(format, blend.then_some(over))
                .prepare()?;
            frame.resolves.insert(key, draw);
        }
        if let Some(draw) = frame.resolves.get(&key) {
            draw.set_params(&self.gpu, &params);
            let load = match target.background {
                Some(_) => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                None => wgpu::LoadOp::Load,
            };
            let colour = [attachment(target.colour, load)];
            let mut pass = work.render_pass("render/resolve", &colour, None);
            draw.record(&mut pass, 3, 1);
        }
        Ok(())
    }

    fn walks(
        &self,
        peel: &Peel,
        view: &View,
        gathered: Gathered,
        occluder: Option<&wgpu::TextureView>,
    ) -> Result<Walks> {
        let flag = |on: bool| f64::from(u8::from(on));
        let mode = match gathered {
            Gathered::Composite => 0.0,
            Gathered::Thickness => 1.0,
            Gathered::Statistics => 2.0,
        };
        let draw = |starts: &wgpu::TextureView, writes: usize, backwards: bool| {
            let sum = &peel.sums[1 - writes];
            let opaque = occluder.unwrap_or(&self.nothing_opaque);
            let geometry = &self.geometry;
            let builder = match self.options.walk {
                Walk::Vertices => self
                    .gpu
                    .draw("render/walk_vertices")
                    .read(&geometry.projected)
                    .read(&geometry.tets)
                    .read(&geometry.links),
                Walk::Planes => self.gpu.draw("render/walk_planes").read(&geometry.records),
            };
            builder
                .read(&geometry.cells)
                .constant("CELLS", flag(geometry.per_cell))
                .constant("MODE", mode)
                .constant("TABLE", self.options.table.code())
                .constant("SAMPLES", self.options.table.samples())
                .constant("OPAQUE", self.options.opaque)
                .constant("BACKWARDS", flag(backwards))
                .constant("OCCLUDED", flag(occluder.is_some()))
                .read(starts)
                .read(&peel.keys[0])
                .read(sum)
                .read(opaque)
                .read(&self.table.view)
                .read(&self.sampler)
                .write(&self.lost)
                .params(view)
                .target(SUM, None)
                .prepare()
        };
        Ok(Walks {
            // The walk towards the eye comes before layer 0, and leaves its sum to it.
            back: draw(&peel.backs, 1, true)?,
            layers: [
                draw(&peel.keys[0], 0, false)?,
                draw(&peel.keys[1], 1, false)?,
            ],
        })
    }

    fn view(&self, camera: &Camera, window: Window) -> View {
        let geometry = &self.geometry;
        View {
            scalar: self.table.scalar(),
            opacity: self.table.opacity,
            nodes: geometry.projected.len(),
            corners: geometry.corners(),
            cap: geometry.tet_count().saturating_add(CAP_SLACK),
            layers: self.table.layers,
            reach: self.table.reach,
            ..LocalView::new(camera, &geometry.frame, window).to_gpu()
        }
    }
}

fn make_table(
    gpu: &Gpu,
    geometry: &Geometry,
    transfer: &TransferFunction,
    options: &RaycastOptions,
) -> Result<Table> {
    Table::new(
        gpu,
        &Wanted {
            form: options.table,
            texel: options.texel,
            size: options.table_size,
            transfer: &transfer.resolved(geometry.range, geometry.frame.scale),
            range: geometry.range,
            scale: geometry.frame.scale,
            longest: geometry.longest_edge,
            accuracy: options.accuracy,
        },
    )
}
