//! Seeing inside a mesh while it moves: the single-pass raycaster.
//!
//! A start pass rasterises the boundary and writes the tet and face where each pixel's ray enters;
//! a fullscreen fragment pass walks the ray from tet to tet to where it leaves, and composites
//! front to back ([`Traversal`] names the two ways to walk). Rays that enter again are peeled off layer
//! by layer ([`super::depth_peeling`]). Segments are looked up in a pre-integrated table
//! ([`super::table`]). Nothing is read back to decide anything.

mod appearance;
mod draw;
mod intervals;
mod shadows;

use super::geometry::Geometry;
use super::image::Image;
use super::image_tiles::draw_in_tiles;
use super::raycast_options::{Integrand, Mode, RaycastOptions, Target};
use super::scan::{Scan, ScanSet};
use super::sections::Sections;
use super::view::{CameraTransform, ImageRegion};
use super::{Camera, ResolvedTransfer, TransferFunction};
use crate::gpu::{Array, Gpu, Recorder, Texel};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use appearance::Appearance;
pub use appearance::RegionAppearance;
use draw::Frame;
use shadows::Shadows;

/// Draws the inside of a [`Geometry`].
pub struct Raycaster {
    pub(super) gpu: Gpu,
    pub(super) geometry: Geometry,
    pub(super) options: RaycastOptions,
    pub(super) looks: Appearance,
    pub(super) sampler: wgpu::Sampler,
    pub(super) lost_rays: wgpu::Buffer,
    nothing_opaque: wgpu::TextureView,
    /// Where regions have no looks of their own.
    no_rows: Array,
    shadows: Option<Shadows>,
    /// Where ways through the mesh are told by themselves, where they were asked for.
    told: Option<wgpu::Buffer>,
    /// Of the last sizes that were drawn, the last one first.
    frames: Vec<Frame>,
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
        let looks = Appearance::new(gpu, &geometry, &options, transfer)?;
        let sampler = gpu.device().create_sampler(&wgpu::SamplerDescriptor {
            label: Some("table"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Ok(Raycaster {
            gpu: gpu.clone(),
            geometry,
            options,
            looks,
            sampler,
            lost_rays: gpu.buffer("lost rays", 4)?,
            nothing_opaque: gpu.target(
                "nothing opaque",
                [1, 1],
                wgpu::TextureFormat::Depth32Float,
                wgpu::TextureUsages::TEXTURE_BINDING,
            )?,
            no_rows: gpu.array("no regions", Texel::U32, 1)?,
            shadows: None,
            told: None,
            frames: Vec::new(),
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
        let geometry = &self.geometry;
        let transfer = self.looks.transfer();
        transfer.to_absolute(self.looks.range(), geometry.frame.scale)
    }

    /// Draws with another transfer function from now on; what is recorded already keeps the one
    /// it was recorded with. The table is made when the next picture is recorded. Regions with
    /// looks of their own keep them.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_transfer(gpu, geometry, options, transfer)?;
        self.prepare_anew();
        Ok(())
    }

    /// Takes over the scalars that its geometry was given since: the table is made anew where their
    /// range is another one, or asks for another.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn update_range(&mut self) -> Result<()> {
        match self.looks.matches(&self.geometry, &self.options) {
            true => Ok(()),
            false => self.set_transfer(&self.looks.transfer().clone()),
        }
    }

    /// Draws each region by a transfer function of its own, or not at all, from now on; with none
    /// all by the one of the raycaster. After a cut that removed tets regions are to be set again.
    ///
    /// # Errors
    /// [`Error::Input`] for regions of another mesh, too many of them, or a table that has room for
    /// one transfer function; the old ones stay.
    pub fn set_regions(&mut self, regions: Option<&RegionAppearance>) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_regions(gpu, geometry, options, regions)?;
        self.prepare_anew();
        Ok(())
    }

    /// Shows scans that the body carries in place of its scalars, or these again, as they were shown,
    /// with none: looked up
    /// at full resolution where the body rests, as `mesh` has it, the first one with all that goes for
    /// a scalar (regions, isosurfaces, projections). The geometry is to remember its rest
    /// ([`Geometry::store_rest_positions`]). After a cut that removed tets scans are to be set again, by
    /// [`Raycaster::follow_scans`]. Returns in words what had to be left out for the device's sake.
    ///
    /// # Errors
    /// [`Error::Input`] for scans that do not meet the mesh, are too many, or hold what they should
    /// not, for isosurfaces beside a first scan of labels, and for a geometry that does not know its rest; [`Error::Gpu`] where they do not fit the
    /// device, however coarse. The old ones stay.
    pub fn set_scans(&mut self, mesh: &TetMesh, scans: &[Scan]) -> Result<Vec<String>> {
        if mesh.tets.len() != self.geometry.tet_count() as usize {
            return Err(Error::Input(
                "scans are carried by the mesh that the geometry was made of, and another is given"
                    .into(),
            ));
        }
        let held = match scans {
            [] => None,
            scans => Some(ScanSet::new(&self.gpu, mesh, scans)?),
        };
        let notes = held.as_ref().map_or(Vec::new(), |held| held.notes.clone());
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_scans(gpu, geometry, options, held)?;
        self.prepare_anew();
        Ok(notes)
    }

    /// The scans it shows, after a cut of `mesh` that its geometry has followed.
    ///
    /// # Errors
    /// As [`Raycaster::set_scans`].
    pub fn follow_scans(&mut self, mesh: &TetMesh) -> Result<()> {
        if let Some((held, _)) = self.looks.scans()
            && held.tets() != mesh.tets.len()
        {
            let held = held.follow(mesh);
            let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
            self.looks
                .update_scans_after_cut(gpu, geometry, options, held)?;
            self.prepare_anew();
        }
        Ok(())
    }

    /// Whether it shows scans.
    pub fn shows_scans(&self) -> bool {
        self.looks.scans().is_some()
    }

    /// Draws with these planes and isosurfaces from now on. Planes given in the body at rest need a
    /// geometry that remembers it ([`Geometry::store_rest_positions`]), isosurfaces scalars at the nodes;
    /// they are lit where there is light.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that make no sense, too many of them, or a geometry that is not
    /// ready; the old ones stay.
    pub fn set_sections(&mut self, inside: &Sections) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_sections(gpu, geometry, options, inside)?;
        self.prepare_anew();
        Ok(())
    }

    /// What was prepared for a picture is prepared anew for the next.
    fn prepare_anew(&mut self) {
        self.shadows = None;
        self.forget_walks();
    }

    /// Walks are prepared anew for the next picture.
    fn forget_walks(&mut self) {
        self.frames.iter_mut().for_each(Frame::invalidate_draws);
    }

    /// The planes and isosurfaces it draws with.
    pub fn inside(&self) -> &Sections {
        self.looks.inside()
    }

    /// How it draws.
    pub fn options(&self) -> &RaycastOptions {
        &self.options
    }

    /// Texels of the table along each scalar.
    pub fn table_size(&self) -> u32 {
        self.looks.table.size
    }

    /// Layers of the table: its slices, the depths of a [`TableKind::Volume`](super::TableKind::Volume), or the
    /// transfer functions in it.
    pub fn table_layers(&self) -> u32 {
        self.looks.table.layers
    }

    /// Draws with other options from now on.
    ///
    /// # Errors
    /// As [`Raycaster::with_options`]; the old ones stay.
    pub fn set_options(&mut self, options: RaycastOptions) -> Result<()> {
        options.check(&self.gpu)?;
        self.looks
            .set_options(&self.gpu, &self.geometry, &options)?;
        self.options = options;
        self.shadows = None;
        self.frames.clear();
        Ok(())
    }

    /// The matrix from file coordinates to the clip space of `camera`, whose depth falls from 1
    /// near the eye to 0: for drawing an occluder.
    pub fn file_to_clip(&self, camera: &Camera, size: [u32; 2]) -> glam::DMat4 {
        let frame = &self.geometry.frame;
        CameraTransform::new(camera, frame, ImageRegion::full(size)).clip_from_file(frame)
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
        let window = ImageRegion::full([texture.width(), texture.height()]);
        self.record_window(work, camera, mode.into(), target, window)
    }

    /// As [`Raycaster::record`], for a part of a picture.
    pub(crate) fn record_region(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        mode: Mode,
        target: &Target,
        window: ImageRegion,
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
            Mode::Thickness | Mode::Xray => (1, pixels.into_iter().map(|p| p[0]).collect()),
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
        gathered: Integrand,
    ) -> Result<(Vec<[f32; 4]>, u32)> {
        let gpu = self.gpu.clone();
        let mut layers = 0;
        let pixels = draw_in_tiles(&gpu, size, |colour, window| {
            let target = Target {
                colour,
                depth: None,
                background: Some([0.0; 4]),
            };
            let mut work = gpu.start_recording();
            self.record_window(&mut work, camera, gathered, &target, window)?;
            work.submit()?;
            layers = layers.max(self.layers_found()?);
            Ok(())
        })?;
        Ok((pixels, layers))
    }

    /// Layers that the last window recorded, and submitted, found.
    pub(super) fn layers_found(&self) -> Result<u32> {
        match self.frames.first() {
            Some(frame) => frame.peel.layer_count(&self.gpu),
            None => Ok(0),
        }
    }
}
