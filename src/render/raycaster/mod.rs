//! Single-pass raycaster for deforming tetrahedral meshes.
//!
//! A start pass rasterises the boundary and writes the entry tet and face of each pixel's ray. A
//! fullscreen fragment pass traverses the ray from tet to tet until it exits and composites front
//! to back ([`Traversal`] lists the two traversal methods). Re-entering rays are handled by depth
//! peeling ([`super::depth_peeling`]). Segments are looked up in a pre-integrated table
//! ([`super::table`]). No control decision requires a GPU readback.

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
use super::{AbsoluteTransferFunction, Camera, TransferFunction};
use crate::gpu::{Array, Gpu, Recorder, Texel};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use appearance::Appearance;
pub use appearance::RegionAppearance;
use draw::Frame;
use shadows::Shadows;

/// Volume renderer of a [`Geometry`].
pub struct Raycaster {
    pub(super) gpu: Gpu,
    pub(super) geometry: Geometry,
    pub(super) options: RaycastOptions,
    pub(super) looks: Appearance,
    pub(super) sampler: wgpu::Sampler,
    pub(super) lost_rays: wgpu::Buffer,
    nothing_opaque: wgpu::TextureView,
    /// Placeholder for the tet rows if regions have no separate appearance.
    pub(super) no_rows: Array,
    shadows: Option<Shadows>,
    /// Output buffer for the separate ray segments, while they are being extracted.
    segment_buffer: Option<wgpu::Buffer>,
    /// Frames of the most recently drawn sizes, the latest first.
    frames: Vec<Frame>,
}

impl Raycaster {
    /// Creates a raycaster for `geometry` with the default [`RaycastOptions`].
    ///
    /// # Errors
    /// An error if the device cannot allocate the resources.
    pub fn new(gpu: &Gpu, geometry: Geometry, transfer: &TransferFunction) -> Result<Raycaster> {
        Raycaster::with_options(gpu, geometry, transfer, RaycastOptions::default())
    }

    /// Creates a raycaster for `geometry`.
    ///
    /// # Errors
    /// As [`Raycaster::new`]; [`Error::Input`] for options out of range.
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
            segment_buffer: None,
            frames: Vec::new(),
        })
    }

    /// Returns the geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the geometry for updates, such as after a cut of its mesh.
    pub fn geometry_mut(&mut self) -> &mut Geometry {
        &mut self.geometry
    }

    /// Returns the transfer function in absolute units.
    pub fn transfer(&self) -> AbsoluteTransferFunction {
        let geometry = &self.geometry;
        let transfer = self.looks.transfer();
        transfer.to_absolute(self.looks.range(), geometry.frame.scale)
    }

    /// Sets the transfer function for subsequent images; images already recorded keep the previous
    /// one. The table is built when the next image is recorded. Regions with their own transfer
    /// functions keep them.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_transfer(gpu, geometry, options, transfer)?;
        self.prepare_anew();
        Ok(())
    }

    /// Updates the appearance after the scalars of the geometry changed: rebuilds the table if
    /// their range or the table specification changed.
    ///
    /// # Errors
    /// As [`Raycaster::new`].
    pub fn update_range(&mut self) -> Result<()> {
        match self.looks.matches(&self.geometry, &self.options) {
            true => Ok(()),
            false => self.set_transfer(&self.looks.transfer().clone()),
        }
    }

    /// Sets a separate transfer function per region, or hides regions, for subsequent images;
    /// `None` restores the single transfer function. Set the regions again after a cut that removed
    /// tets.
    ///
    /// # Errors
    /// [`Error::Input`] if the regions do not match the mesh, are too many, or the table has room
    /// for only one transfer function; the previous regions stay in effect.
    pub fn set_regions(&mut self, regions: Option<&RegionAppearance>) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_regions(gpu, geometry, options, regions)?;
        self.prepare_anew();
        Ok(())
    }

    /// Shows scans attached to the body instead of the mesh scalars; an empty slice restores the
    /// scalars. Scans are sampled at full resolution at the rest position given by `mesh`; the
    /// first scan takes the role of the scalar (regions, isosurfaces, projections). The geometry
    /// must store its rest positions ([`Geometry::store_rest_positions`]). After a cut that removed
    /// tets, call [`Raycaster::follow_scans`]. Returns a description of the data omitted because of
    /// device limits.
    ///
    /// # Errors
    /// [`Error::Input`] for scans that do not intersect the mesh, are too many or contain invalid
    /// values, for isosurfaces combined with a label map as first scan, and for a geometry without
    /// rest positions; [`Error::Gpu`] if the scans do not fit the device even at reduced
    /// resolution. The previous scans stay in effect.
    pub fn set_scans(&mut self, mesh: &TetMesh, scans: &[Scan]) -> Result<Vec<String>> {
        if mesh.tets.len() != self.geometry.tet_count() as usize {
            return Err(Error::Input(
                "mesh of the scans must be the mesh of the geometry; pass the mesh it was created from"
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

    /// Updates the displayed scans after a cut of `mesh` that has been applied to the geometry.
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

    /// Whether scans are shown.
    pub fn shows_scans(&self) -> bool {
        self.looks.scans().is_some()
    }

    /// Sets the section planes and isosurfaces for subsequent images. Planes fixed to the rest
    /// configuration need a geometry with rest positions ([`Geometry::store_rest_positions`]),
    /// isosurfaces need scalars at the nodes. Isosurfaces and planes are shaded if lighting is on.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid numbers, too many planes or isosurfaces, or a geometry without
    /// the required data; the previous sections stay in effect.
    pub fn set_sections(&mut self, inside: &Sections) -> Result<()> {
        let (gpu, geometry, options) = (&self.gpu, &self.geometry, &self.options);
        self.looks.set_sections(gpu, geometry, options, inside)?;
        self.prepare_anew();
        Ok(())
    }

    /// Invalidates the shadows and the prepared draws.
    fn prepare_anew(&mut self) {
        self.shadows = None;
        self.forget_walks();
    }

    /// Invalidates the prepared draws.
    fn forget_walks(&mut self) {
        self.frames.iter_mut().for_each(Frame::invalidate_draws);
    }

    /// Returns the section planes and isosurfaces.
    pub fn inside(&self) -> &Sections {
        self.looks.inside()
    }

    /// Returns the options.
    pub fn options(&self) -> &RaycastOptions {
        &self.options
    }

    /// Returns the table size along each scalar axis, in texels.
    pub fn table_size(&self) -> u32 {
        self.looks.table.size
    }

    /// Returns the number of table layers: its slices, the depths of a
    /// [`TableKind::Volume`](super::TableKind::Volume), or the number of transfer functions.
    pub fn table_layers(&self) -> u32 {
        self.looks.table.layers
    }

    /// Sets the options for subsequent images.
    ///
    /// # Errors
    /// As [`Raycaster::with_options`]; the previous options stay in effect.
    pub fn set_options(&mut self, options: RaycastOptions) -> Result<()> {
        options.check(&self.gpu)?;
        self.looks
            .set_options(&self.gpu, &self.geometry, &options)?;
        self.options = options;
        self.shadows = None;
        self.frames.clear();
        Ok(())
    }

    /// Returns the matrix from file coordinates to the clip space of `camera`, for drawing an
    /// occluder. Depth is reversed: 1 near the eye, falling to 0.
    pub fn file_to_clip(&self, camera: &Camera, size: [u32; 2]) -> glam::DMat4 {
        let frame = &self.geometry.frame;
        CameraTransform::new(camera, frame, ImageRegion::full(size)).clip_from_file(frame)
    }

    /// Records the drawing of an image into `target`. Refreshes data that depends on the positions
    /// if needed; does not read back. Any number of images with different cameras, sizes or
    /// transfer functions can be recorded before submission. The first image with a new transfer
    /// function submits the computation of its table.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera, [`Error::Gpu`] if the device fails.
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

    /// As [`Raycaster::record`], for a region of an image.
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

    /// Renders a composited image of `size` pixels. Waits for the GPU and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn picture(&mut self, camera: &Camera, size: [u32; 2]) -> Result<Image> {
        self.image(camera, size, Mode::Composite)
    }

    /// Renders an image of `size` pixels in `mode`. Waits for the GPU and reads back.
    ///
    /// # Errors
    /// As [`Raycaster::record`]; and [`Error::Input`] if a ray enters the mesh more often than the
    /// layer limit allows.
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
                "a ray enters the mesh more than {0} times, the limit of layers; increase --layers",
                self.options.layers
            )));
        }
        Ok(())
    }

    /// Returns all pixels of an image and the maximum number of layers that a tile needed.
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

    /// Returns the number of layers found in the last submitted window.
    pub(super) fn layers_found(&self) -> Result<u32> {
        match self.frames.first() {
            Some(frame) => frame.peel.layer_count(&self.gpu),
            None => Ok(0),
        }
    }
}
