//! Seeing inside a mesh while it moves: the single-pass raycaster.
//!
//! A start pass rasterises the boundary and writes the tet and face where each pixel's ray enters;
//! a fullscreen fragment pass walks the ray from tet to tet to where it leaves, and composites
//! front to back ([`Walk`] names the two ways to walk). Rays that enter again are peeled off layer
//! by layer ([`super::peel`]). Segments are looked up in a pre-integrated table
//! ([`super::table`]). Nothing is read back to decide anything.

use super::geometry::Geometry;
use super::image::Image;
use super::inside::{Inside, colours};
use super::peel::{Peel, SUM, Walks, attachment};
use super::raycast_options::{Gathered, Mode, RaycastOptions, Target, Walk};
use super::table::{Table, Wanted};
use super::tiles::{check_size, draw_in_tiles};
use super::view::{LocalView, View, Window};
use super::{Camera, ResolvedTransfer, TransferFunction};
use crate::gpu::{Array, Draw, Gpu, Recorder};
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

/// A walk is given up after this many tets beyond those there are.
const CAP_SLACK: u32 = 16;

/// Draws the inside of a [`Geometry`].
pub struct Raycaster {
    pub(super) gpu: Gpu,
    pub(super) geometry: Geometry,
    /// The range of scalars that the table was made for.
    range: (f64, f64),
    pub(super) options: RaycastOptions,
    transfer: TransferFunction,
    pub(super) table: Table,
    inside: Inside,
    /// Planes and isosurfaces, and colours, as walks read them.
    inside_items: [Array; 2],
    pub(super) sampler: wgpu::Sampler,
    pub(super) lost: wgpu::Buffer,
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
    /// By format, whether blended over what is there, and whether a projection is shown.
    resolves: HashMap<(wgpu::TextureFormat, bool, bool), Draw>,
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
        let range = geometry.range;
        let inside = Inside::default();
        let inside_items = inside_items(gpu, &geometry, transfer, &table, &inside)?;
        let sampler = gpu.device().create_sampler(&wgpu::SamplerDescriptor {
            label: Some("table"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Ok(Raycaster {
            gpu: gpu.clone(),
            geometry,
            range,
            options,
            transfer: transfer.clone(),
            table,
            inside,
            inside_items,
            sampler,
            lost: gpu.buffer("lost rays", 4)?,
            nothing_opaque: gpu.target(
                "nothing opaque",
                [1, 1],
                wgpu::TextureFormat::Depth32Float,
                wgpu::TextureUsages::TEXTURE_BINDING,
            )?,
            frame: None,
        })
    }

    /// What it draws.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// What it draws, to follow the cuts of its mesh.
    pub fn geometry_mut(&mut self) -> &mut Geometry {
        &mut self.geometry
    }

    /// The transfer function, in absolute terms.
    pub fn transfer(&self) -> ResolvedTransfer {
        self.transfer
            .resolved(self.geometry.range, self.geometry.frame.scale)
    }

    /// Draws with another transfer function from now on; what is recorded already keeps the one
    /// it was recorded with. The table is built on the GPU when the next picture is recorded.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        let table = make_table(&self.gpu, &self.geometry, transfer, &self.options)?;
        self.inside_items =
            inside_items(&self.gpu, &self.geometry, transfer, &table, &self.inside)?;
        self.table = table;
        self.range = self.geometry.range;
        self.transfer = transfer.clone();
        if let Some(frame) = &mut self.frame {
            frame.walks.clear();
        }
        Ok(())
    }

    /// Takes over the range of scalars that its geometry was given since: the table is made anew
    /// where it is another one.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn refresh_range(&mut self) -> Result<()> {
        match self.range == self.geometry.range {
            true => Ok(()),
            false => self.set_transfer(&self.transfer.clone()),
        }
    }

    /// Draws with these planes and isosurfaces from now on. Planes given in the body at rest need a
    /// geometry that remembers it ([`Geometry::remember_rest`]), isosurfaces scalars at the nodes;
    /// they are lit where there is light.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that make no sense, too many of them, or a geometry that is not
    /// ready; the old ones stay.
    pub fn set_inside(&mut self, inside: &Inside) -> Result<()> {
        inside.check()?;
        if inside.needs_rest() && self.geometry.rests().is_none() {
            return Err(Error::Input(
                "the geometry does not know where it rests; call Geometry::remember_rest first"
                    .into(),
            ));
        }
        if !inside.isosurfaces.is_empty() && self.geometry.per_cell {
            return Err(Error::Input(
                "isosurfaces need a field at the nodes: one that is constant in each tet has none"
                    .into(),
            ));
        }
        self.inside_items = inside_items(
            &self.gpu,
            &self.geometry,
            &self.transfer,
            &self.table,
            inside,
        )?;
        self.inside = inside.clone();
        if let Some(frame) = &mut self.frame {
            frame.walks.clear();
        }
        Ok(())
    }

    /// The planes and isosurfaces it draws with.
    pub fn inside(&self) -> &Inside {
        &self.inside
    }

    /// How it draws.
    pub fn options(&self) -> &RaycastOptions {
        &self.options
    }

    /// Texels of the table along each scalar.
    pub fn table_size(&self) -> u32 {
        self.table.size
    }

    /// Layers of the table: its slices, or the depths of a [`TableForm::Volume`](super::TableForm::Volume).
    pub fn table_layers(&self) -> u32 {
        self.table.layers
    }

    /// Draws with other options from now on.
    ///
    /// # Errors
    /// As [`Raycaster::with_options`]; the old ones stay.
    pub fn set_options(&mut self, options: RaycastOptions) -> Result<()> {
        options.check(&self.gpu)?;
        let table = make_table(&self.gpu, &self.geometry, &self.transfer, &options)?;
        self.inside_items = inside_items(
            &self.gpu,
            &self.geometry,
            &self.transfer,
            &table,
            &self.inside,
        )?;
        self.table = table;
        self.range = self.geometry.range;
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
    /// first where needed; reads nothing back. Any number of pictures, of several cameras, sizes
    /// or transfer functions, can be recorded before they are submitted. The first one of a
    /// transfer function submits the building of its table.
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

    /// The picture of `camera`, of `size` pixels, as a volume. Waits and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn picture(&mut self, camera: &Camera, size: [u32; 2]) -> Result<Image> {
        self.image(camera, size, Mode::Composite)
    }

    /// The picture of `camera` in `mode`, of `size` pixels. Waits and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::record`]; and [`Error::Input`] when a ray enters more often than there are
    /// layers for.
    pub fn image(&mut self, camera: &Camera, size: [u32; 2], mode: Mode) -> Result<Image> {
        let (pixels, layers) = self.gather(camera, size, mode.into())?;
        self.check_layers(layers)?;
        let (channels, values) = match mode {
            Mode::Thickness => (1, pixels.into_iter().map(|p| p[0]).collect()),
            _ => (4, pixels.into_iter().flatten().collect()),
        };
        Ok(Image {
            size,
            channels,
            values,
        })
    }

    pub(super) fn check_layers(&self, found: u32) -> Result<()> {
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
            layers = layers.max(self.layers_found()?);
            Ok(())
        })?;
        Ok((pixels, layers))
    }

    /// Layers that the last window recorded, and submitted, found.
    pub(super) fn layers_found(&self) -> Result<u32> {
        match &self.frame {
            Some(frame) => frame.peel.layers_found(&self.gpu),
            None => Ok(0),
        }
    }

    pub(super) fn record_window(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        gathered: Gathered,
        target: &Target,
        window: Window,
    ) -> Result<()> {
        camera.check()?;
        let view = self.view_of(camera, window, gathered);
        self.table.fill(&self.gpu)?;
        if self.options.walk == Walk::Planes {
            self.geometry.record_refresh(work);
        }
        if self.options.light.is_on() && gathered == Gathered::Composite {
            if self.geometry.gradients().is_none() {
                return Err(Error::Input(
                    "the geometry is not ready for light; call Geometry::illuminate first".into(),
                ));
            }
            self.geometry.record_gradients(work);
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
            let report = gathered == Gathered::Statistics;
            frame.peel.record(work, walks, view, report)?;
        }
        self.resolve(work, frame, target, gathered.is_projection())
    }

    /// Brings the sum of the last layer that ran into the target.
    fn resolve(
        &self,
        work: &mut Recorder,
        frame: &mut Frame,
        target: &Target,
        projected: bool,
    ) -> Result<()> {
        let params = gpu_data::Resolve {
            background: target.background.unwrap_or_default(),
            layers: frame.peel.layers,
            _pad: [0; 3],
        };
        let format = target.colour.texture().format();
        let blend = target.background.is_none();
        let key = (format, blend, projected);
        if !frame.resolves.contains_key(&key) {
            let peel = &frame.peel;
            let over = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
            let draw = self
                .gpu
                .draw("render/resolve")
                .constant("PROJECTED", f64::from(u8::from(projected)))
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
            draw.set_params(work, &params)?;
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
            let lit = self.options.light.is_on() && gathered == Gathered::Composite;
            let gradients = geometry.gradients().unwrap_or(&geometry.projected);
            let builder = match self.options.walk {
                Walk::Vertices => builder.read(&geometry.cells),
                Walk::Planes => builder
                    .read(&geometry.cells)
                    .read(&geometry.tets)
                    .read(&geometry.positions),
            };
            let [clips, slices, isosurfaces] = self.inside.counts().map(|n| n as f64);
            let resting = self.inside.needs_rest();
            let [inside, colours] = &self.inside_items;
            let rests = geometry.rests().filter(|_| resting).unwrap_or(inside);
            builder
                .read(gradients)
                .constant("LIT", flag(lit))
                .constant("CLIPS", clips)
                .constant("SLICES", slices)
                .constant("ISOS", isosurfaces)
                .constant("RESTING", flag(resting))
                .constant("VOLUME", flag(self.inside.volume))
                .constant("CELLS", flag(geometry.per_cell))
                .constant("MODE", gathered.code())
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
                .read(inside)
                .read(colours)
                .read(rests)
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

    /// As [`Raycaster::view`], of a picture of `gathered`.
    fn view_of(&self, camera: &Camera, window: Window, gathered: Gathered) -> View {
        let view = self.view(camera, window);
        if !gathered.is_projection() {
            return view;
        }
        // Scalars are shares of the range already, and no table is looked up.
        View {
            scalar: [1.0, 0.0],
            ..view
        }
    }

    pub(super) fn view(&self, camera: &Camera, window: Window) -> View {
        let geometry = &self.geometry;
        View {
            scalar: self.table.scalar(),
            opacity: self.table.opacity,
            nodes: geometry.projected.len(),
            corners: geometry.corners(),
            cap: geometry.tet_count().saturating_add(CAP_SLACK),
            layers: self.table.layers,
            reach: self.table.reach,
            light: self.options.light.to_gpu(),
            ..LocalView::new(camera, &geometry.frame, window).to_gpu()
        }
    }
}

/// What walks read of planes, isosurfaces and colours.
fn inside_items(
    gpu: &Gpu,
    geometry: &Geometry,
    transfer: &TransferFunction,
    table: &Table,
    inside: &Inside,
) -> Result<[Array; 2]> {
    let (low, high) = geometry.range;
    let [scale, shift] = table.scalar().map(f64::from);
    let coordinate = |s: f64| scale * (s - low) / (high - low) + shift;
    let resolved = transfer.resolved(geometry.range, geometry.frame.scale);
    Ok([
        inside.to_gpu(gpu, geometry.frame, coordinate)?,
        colours(gpu, &resolved, geometry.range)?,
    ])
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
