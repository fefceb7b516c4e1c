//! Raycast options: traversal method, integrand and render target.

use super::light::Light;
use super::table::{TABLE_SIZES, TableKind, TableTexel};
use super::xray::Xray;
use crate::gpu::Gpu;
use crate::{Error, Result};

/// Traversal method of rays from tet to tet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Traversal {
    /// Keeps three projected vertices and fetches one per step: faster, and correct for inverted
    /// tets.
    #[default]
    Vertices,
    /// Method of the paper: the nearest plane ahead, and the scalar from the gradient.
    Planes,
}

/// How shaders read the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum MeshAccess {
    /// The faster access for the adapter: storage textures on a software driver, sampled textures
    /// on a GPU.
    #[default]
    Auto,
    /// Read-only storage textures.
    Stored,
    /// Sampled textures, read without a sampler.
    Sampled,
}

impl MeshAccess {
    /// Whether the mesh is read from storage textures on this device.
    pub(super) fn are_stored(self, gpu: &Gpu) -> bool {
        match self {
            MeshAccess::Auto => gpu.adapter().device_type == wgpu::DeviceType::Cpu,
            MeshAccess::Stored => true,
            MeshAccess::Sampled => false,
        }
    }
}

/// Quantity computed along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// Emission and absorption with the transfer function.
    #[default]
    Composite,
    /// Length inside the mesh, in file units.
    Thickness,
    /// Maximum scalar along the ray, in grey: black at the lower end of the geometry's scalar
    /// range, white at the upper end.
    Maximum,
    /// Minimum scalar along the ray.
    Minimum,
    /// Mean scalar over the length inside the mesh.
    Mean,
    /// X-ray attenuation ∫ μ dl with [`RaycastOptions::xray`]; deformation conserves mass.
    Xray,
}

/// Integrands of the shaders: those of [`Mode`], separate ray segments, and counts for a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Integrand {
    Composite,
    /// As `Composite`; also outputs each ray segment separately.
    Intervals,
    Thickness,
    Statistics,
    Maximum,
    Minimum,
    Mean,
    Xray,
}

impl Integrand {
    /// Returns the code in `lib/segment.wgsl`.
    pub fn code(self) -> f64 {
        match self {
            Integrand::Composite | Integrand::Intervals => 0.0,
            Integrand::Thickness => 1.0,
            Integrand::Statistics => 2.0,
            Integrand::Maximum => 3.0,
            Integrand::Minimum => 4.0,
            Integrand::Mean => 5.0,
            Integrand::Xray => 6.0,
        }
    }

    /// Whether the integrand is emission and absorption.
    pub fn is_composite(self) -> bool {
        matches!(self, Integrand::Composite | Integrand::Intervals)
    }

    /// Whether the integrand is a projection of a scalar.
    pub fn is_projection(self) -> bool {
        matches!(
            self,
            Integrand::Maximum | Integrand::Minimum | Integrand::Mean
        )
    }
}

impl From<Mode> for Integrand {
    fn from(mode: Mode) -> Integrand {
        match mode {
            Mode::Composite => Integrand::Composite,
            Mode::Thickness => Integrand::Thickness,
            Mode::Maximum => Integrand::Maximum,
            Mode::Minimum => Integrand::Minimum,
            Mode::Mean => Integrand::Mean,
            Mode::Xray => Integrand::Xray,
        }
    }
}

/// Options of a raycaster; see [`RaycastOptions::for_tolerance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaycastOptions {
    /// Traversal method.
    pub walk: Traversal,
    /// Access to the mesh.
    pub reads: MeshAccess,
    /// Lookup method of segments.
    pub table: TableKind,
    /// Texel format of the table.
    pub texel: TableTexel,
    /// Texels of the table along each scalar, and layers of a [`TableKind::Volume`]; `None` chooses
    /// by `table_tolerance`.
    pub table_size: Option<u32>,
    /// Opacity at which a ray ends (early ray termination); 1 follows each ray to its end.
    pub opacity_cutoff: f64,
    /// Maximum number of times a ray may enter the mesh (`--layers`).
    pub layers: u32,
    /// Pixel error for which the table size is chosen.
    pub table_tolerance: f64,
    /// Light of the volume in [`Mode::Composite`]. Requires
    /// [`Geometry::enable_lighting`](super::Geometry::enable_lighting).
    pub light: Light,
    /// Shadow strength from 0 (off, no cost) to 1: soft shadows for a directional light, ambient
    /// occlusion for a headlight.
    pub shadows: f64,
    /// Maximum distance between two samples of a [`Scan`](super::Scan), in voxels, from 1/64 to 1.
    pub scan_step: f64,
    /// X-ray source and CT calibration for [`Mode::Xray`].
    pub xray: Xray,
}

impl RaycastOptions {
    pub(super) fn check(&self, gpu: &Gpu) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        if !(1..=255).contains(&self.layers) {
            return wrong(format!(
                "layer count must be 1 to 255, got {}; change it with --layers",
                self.layers
            ));
        }
        if !(self.opacity_cutoff > 0.0 && self.opacity_cutoff <= 1.0) {
            return wrong(format!(
                "ray termination opacity must be > 0 and ≤ 1, got {}",
                self.opacity_cutoff
            ));
        }
        if !(self.table_tolerance > 0.0 && self.table_tolerance.is_finite()) {
            return wrong(format!(
                "table tolerance must be > 0 and finite (pixel values are 0 to 1), got {}",
                self.table_tolerance
            ));
        }
        self.light.check()?;
        self.xray.check()?;
        if !(0.0..=1.0).contains(&self.shadows) {
            return wrong(format!(
                "shadow strength must be 0 (off) to 1, got {}",
                self.shadows
            ));
        }
        if !(1.0 / 64.0..=1.0).contains(&self.scan_step) {
            return wrong(format!(
                "scan sampling distance must be 1/64 to 1 voxels, got {}",
                self.scan_step
            ));
        }
        self.table.check()?;
        self.texel.check(gpu)?;
        match self.table_size {
            Some(size) if !TABLE_SIZES.contains(&size) => wrong(format!(
                "table size must be {} to {} texels per side, got {size}",
                TABLE_SIZES.start(),
                TABLE_SIZES.end()
            )),
            _ => Ok(()),
        }
    }
}

/// Render target of an image.
pub struct Target<'a> {
    /// Colour attachment; its size is the image size.
    pub colour: &'a wgpu::TextureView,
    /// Depth of opaque objects that occlude the volume (`Depth32Float`, drawn with
    /// [`Raycaster::file_to_clip`](super::Raycaster::file_to_clip)).
    pub depth: Option<&'a wgpu::TextureView>,
    /// Background colour (red, green, blue, opacity) that replaces the previous content; `None`
    /// blends the image over it.
    pub background: Option<[f32; 4]>,
}

/// Statistics of the rays of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RaycastReport {
    /// Number of pixels whose ray hits the mesh.
    pub rays: u64,
    /// Number of rays not followed to their end; 0 unless tets are inverted. Detects traversals
    /// that end neither at the boundary nor opaque, and rays with unequal numbers of entries
    /// (including starts inside the mesh) and exits, such as a missing start; a ray with both
    /// defects counts twice. Does not detect a ray for which the rasteriser missed equal numbers of
    /// entries and exits.
    pub lost_rays: u64,
    /// Mean number of tets per ray.
    pub tets_per_ray: f64,
    /// Maximum number of times a ray enters the mesh.
    pub peel_layers: u32,
    /// Number of inverted or degenerate tets.
    pub inverted: u32,
}
