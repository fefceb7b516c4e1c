//! Recording of an image: layers, their traversal draws, and resolving the accumulated result into
//! the target.

use super::Raycaster;
use crate::gpu::{Array, Draw, DrawBuilder, Recorder};
use crate::render::Camera;
use crate::render::depth_peeling::{CACHED_SIZES, Peel, SUM, TraversalDraws, attachment};
use crate::render::image_tiles::check_size;
use crate::render::raycast_options::{Integrand, Target, Traversal};
use crate::render::scan::ScanSet;
use crate::render::view::{CameraTransform, ImageRegion, View};
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

/// Margin added to the tet count to get the maximum number of steps of a ray; the ray is abandoned
/// beyond it.
const STEP_LIMIT_MARGIN: u32 = 16;

/// Resources for one image size.
pub(super) struct Frame {
    /// Generation of the geometry that the frame was created for.
    generation: u64,
    pub peel: Peel,
    walks: HashMap<(Integrand, bool), TraversalDraws>,
    /// Occluder depth texture that the draws are bound to.
    occluder: Option<wgpu::TextureView>,
    /// Keyed by target format, whether to blend over the target, and whether the integrand is a
    /// projection.
    resolves: HashMap<(wgpu::TextureFormat, bool, bool), Draw>,
}

impl Frame {
    pub fn invalidate_draws(&mut self) {
        self.walks.clear();
    }
}

impl Raycaster {
    pub(in crate::render) fn record_window(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        gathered: Integrand,
        target: &Target,
        window: ImageRegion,
    ) -> Result<()> {
        camera.check()?;
        check_size(window.size)?;
        let view = self.view_of(camera, window, gathered);
        self.looks.check(&self.geometry)?;
        self.looks.table.fill(&self.gpu)?;
        if self.options.walk == Traversal::Planes {
            self.geometry.record_refresh(work)?;
        }
        if self.options.light.is_on() && gathered.is_composite() {
            let from_nodes = self.looks.scans().is_none() || self.options.shadows > 0.0;
            if from_nodes && self.geometry.gradients().is_none() {
                return Err(Error::Input(
                    "the geometry has no gradients for lighting; call Geometry::enable_lighting first"
                        .into(),
                ));
            }
            let gradients_changed = self.geometry.record_gradients(work);
            if self.options.shadows > 0.0 {
                self.record_shadows(work, gradients_changed)?;
            }
        }
        if gathered == Integrand::Xray && self.geometry.rest_positions().is_none() {
            return Err(Error::Input(
                "X-rays need the density relative to rest, but the geometry has no rest positions; call Geometry::store_rest_positions first".into(),
            ));
        }
        let of_labels = |(held, _): (&ScanSet, _)| held.transfer().is_none();
        let sums_values = matches!(
            gathered,
            Integrand::Xray | Integrand::Maximum | Integrand::Minimum | Integrand::Mean
        );
        if sums_values && self.looks.scans().is_some_and(of_labels) {
            return Err(Error::Input(
                "projections and X-rays need values, but the first scan is a label map; show its values (labels = false), or put a scan of values before it".into(),
            ));
        }
        // The frame is moved out of `self` while draws are built from the other fields.
        let generation = self.geometry.generation;
        self.frames.retain(|f| f.generation == generation);
        let kept = self.frames.iter().position(|f| f.peel.size == window.size);
        let mut frame = match kept {
            Some(at) => self.frames.remove(at),
            None => Frame {
                generation,
                peel: Peel::new(
                    &self.geometry,
                    &view,
                    window.size,
                    self.options.layers,
                    self.options.reads.are_stored(&self.gpu),
                )?,
                walks: HashMap::new(),
                occluder: None,
                resolves: HashMap::new(),
            },
        };
        let drawn = self.draw(work, &mut frame, &view, gathered, target);
        self.frames.truncate(CACHED_SIZES - 1);
        self.frames.insert(0, frame);
        drawn
    }

    fn draw(
        &self,
        work: &mut Recorder,
        frame: &mut Frame,
        view: &View,
        gathered: Integrand,
        target: &Target,
    ) -> Result<()> {
        if frame.occluder.as_ref() != target.depth {
            frame.walks.retain(|(_, occluded), _| !occluded);
            frame.occluder = target.depth.cloned();
        }
        let key = (gathered, target.depth.is_some());
        if !frame.walks.contains_key(&key) {
            let walks = self.walks(&frame.peel, view, gathered, target.depth)?;
            frame.walks.insert(key, walks);
        }
        if let Some(walks) = frame.walks.get(&key) {
            let report = gathered == Integrand::Statistics;
            frame.peel.record(work, walks, view, report)?;
        }
        self.resolve(work, frame, target, gathered.is_projection())
    }

    /// Resolves the sum of the last recorded layer into the target.
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
                .constant("PROJECTION_MODE", f64::from(u8::from(projected)))
                .read(&peel.accumulators[0])
                .read(&peel.accumulators[1])
                .read(&peel.last_layers[0])
                .read(&peel.last_layers[1])
                .params(&params)
                .target(format, blend.then_some(over))
                .build()?;
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

    /// Creates the draws that traverse the layers of `peel`.
    fn walks(
        &self,
        peel: &Peel,
        view: &View,
        gathered: Integrand,
        occluder: Option<&wgpu::TextureView>,
    ) -> Result<TraversalDraws> {
        let segment_buffer = self.segment_buffer.as_ref();
        let segment_buffer = segment_buffer.filter(|_| gathered == Integrand::Intervals);
        let name = self.walk_name(segment_buffer.is_some());
        let draw = |starts: &wgpu::TextureView, writes: usize, backwards: bool| {
            let sum = &peel.accumulators[1 - writes];
            let opaque = occluder.unwrap_or(&self.nothing_opaque);
            let (geometry, looks) = (&self.geometry, &self.looks);
            let lit = self.options.light.is_on() && gathered.is_composite();
            let resting = looks.needs_rest() || gathered == Integrand::Xray;
            // Bindings that this variant does not read get a small placeholder array.
            let nothing = &looks.sections;
            let shadows = self.shadows.as_ref().filter(|_| lit);
            let gradients = shadows.map(|s| &s.lit).or(geometry.gradients());
            let gradients = gradients.unwrap_or(nothing);
            let rests = geometry
                .rest_positions()
                .filter(|_| resting)
                .unwrap_or(nothing);
            let rows = looks.rows().unwrap_or(&self.no_rows);
            let mut builder = self.walk_reads(&name, gradients)?;
            if let Some(segment_buffer) = segment_buffer {
                builder = builder.write(segment_buffer);
            }
            self.walk_constants(builder, gathered, [lit, shadows.is_some(), resting])
                .constant("BACKWARD_TRAVERSAL", f64::from(u8::from(backwards)))
                .constant("HAS_DEPTH", f64::from(u8::from(occluder.is_some())))
                .read(&looks.sections)
                .read(&looks.colours)
                .read(rests)
                .read(rows)
                .read(starts)
                .read(&peel.keys[0])
                .read(sum)
                .read(opaque)
                .write(&self.lost_rays)
                .read(&peel.last_layers[writes])
                .params(view)
                .target(SUM, None)
                .build()
        };
        Ok(TraversalDraws {
            // The traversal towards the eye runs before layer 0 and passes its sum to layer 0.
            back: draw(&peel.back_faces, 1, true)?,
            layers: [
                draw(&peel.keys[0], 0, false)?,
                draw(&peel.keys[1], 1, false)?,
            ],
        })
    }

    /// Returns the name of the traversal's shader with its terms; `lists_segments` is whether
    /// it writes the ray segments.
    fn walk_name(&self, lists_segments: bool) -> String {
        let stored = self.options.reads.are_stored(&self.gpu);
        let walk = match self.options.walk {
            Traversal::Vertices => "render/walk_vertices",
            Traversal::Planes => "render/walk_planes",
        };
        let reads = if stored { "stored" } else { "sampled" };
        let scan = match self.looks.scans() {
            Some(_) => " scan",
            None => "",
        };
        let intervals = if lists_segments { " intervals" } else { "" };
        let table = self.looks.table.form.term(stored);
        format!("{walk} {reads} {table}{scan}{intervals}")
    }

    /// Starts a draw of the traversal with the arrays of the mesh, the table and the scans.
    fn walk_reads<'a>(&'a self, name: &'a str, gradients: &'a Array) -> Result<DrawBuilder<'a>> {
        let (geometry, looks) = (&self.geometry, &self.looks);
        let builder = self.gpu.draw(name);
        let mut builder = match self.options.walk {
            Traversal::Vertices => builder
                .read(&geometry.projected)
                .read(&geometry.links)
                .read(gradients)
                .read(&geometry.tets)
                .read(&geometry.cells),
            Traversal::Planes => {
                let records = geometry.records().ok_or_else(|| {
                    Error::Gpu("the tet records of the plane traversal are missing".into())
                })?;
                builder
                    .read(records)
                    .read(&geometry.cells)
                    .read(&geometry.tets)
                    .read(&geometry.positions)
                    .read(gradients)
            }
        };
        builder = builder.read(&looks.table.view);
        if looks.table.form.is_sampled() {
            builder = builder.read(&self.sampler);
        }
        if let Some((held, places)) = looks.scans() {
            builder = builder
                .read(&held.texture)
                .read(&held.sampler)
                .read(places)
                .constant("SCAN_COUNT", held.scans.len() as f64)
                .constant("LABELS", f64::from(u8::from(held.has_labels())))
                .constant("SCAN_STEP", self.options.scan_step)
                .constant("HAS_SCANS", 1.0);
        }
        Ok(builder)
    }

    /// Sets the constants that do not depend on the layer: whether the light acts, whether there
    /// are shadows, and whether rest positions are read.
    fn walk_constants<'a>(
        &'a self,
        mut builder: DrawBuilder<'a>,
        gathered: Integrand,
        [lit, shadowed, resting]: [bool; 3],
    ) -> DrawBuilder<'a> {
        let flag = |on: bool| f64::from(u8::from(on));
        let looks = &self.looks;
        let [clips, slices, isosurfaces] = looks.inside().counts().map(|n| n as f64);
        for (constant, value) in looks.table.constants() {
            builder = builder.constant(constant, *value);
        }
        let per_node = lit && (looks.scans().is_none() || shadowed);
        builder
            .constant("LIGHTING", flag(lit))
            .constant("SHADOWS", flag(shadowed))
            .constant("PER_NODE_LIGHT", flag(per_node))
            .constant("CLIP_PLANE_COUNT", clips)
            .constant("SLICE_COUNT", slices)
            .constant("ISOSURFACE_COUNT", isosurfaces)
            .constant("USE_REST_POSITIONS", flag(resting))
            .constant("DRAW_VOLUME", flag(looks.inside().draw_volume))
            .constant("HAS_REGIONS", flag(looks.rows().is_some()))
            .constant("CELL_SCALARS", flag(self.geometry.is_cell_scalar))
            .constant("INTEGRAND", gathered.code())
            .constant("OPACITY_CUTOFF", self.options.opacity_cutoff)
    }

    /// Returns [`Raycaster::view`] for an image of `gathered`.
    fn view_of(&self, camera: &Camera, window: ImageRegion, gathered: Integrand) -> View {
        let view = self.view(camera, window);
        if !gathered.is_projection() && gathered != Integrand::Xray {
            return view;
        }
        // Scalars are already normalised to the range, and no table is sampled.
        View {
            scalar: [1.0, 0.0],
            ..view
        }
    }

    pub(in crate::render) fn view(&self, camera: &Camera, window: ImageRegion) -> View {
        let (geometry, table) = (&self.geometry, &self.looks.table);
        View {
            scalar: table.scalar,
            opacity: table.opacity,
            nodes: geometry.projected.len(),
            corners: geometry.corners(),
            max_steps: geometry.tet_count().saturating_add(STEP_LIMIT_MARGIN),
            layers: table.layers,
            table_max_depth: table.max_depth,
            light: self.options.light.to_gpu(),
            xray: self.options.xray.to_gpu(self.looks.range()),
            ..CameraTransform::new(camera, &geometry.frame, window).to_gpu()
        }
    }
}
