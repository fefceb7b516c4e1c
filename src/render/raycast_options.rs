//! What a raycaster is asked for: how rays walk, what they gather, and where that is drawn.

use super::light::Light;
use super::table::{TABLE_SIZES, TableKind, TableTexel};
use super::xray::Xray;
use crate::gpu::Gpu;
use crate::{Error, Result};

/// How a ray finds its way from tet to tet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Traversal {
    /// Three projected vertices carried along, one fetched a step: faster, and right also where
    /// a tet is inverted.
    #[default]
    Vertices,
    /// The paper's: the nearest plane ahead, and the scalar from the gradient.
    Planes,
}

/// How a walk reads the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum MeshAccess {
    /// As is faster on the adapter: from storage textures on a software driver, from sampled ones
    /// on a GPU.
    #[default]
    Auto,
    /// From read-only storage textures.
    Stored,
    /// From sampled textures, without a sampler.
    Sampled,
}

impl MeshAccess {
    /// Whether they are from storage textures, on this device.
    pub(super) fn are_stored(self, gpu: &Gpu) -> bool {
        match self {
            MeshAccess::Auto => gpu.adapter().device_type == wgpu::DeviceType::Cpu,
            MeshAccess::Stored => true,
            MeshAccess::Sampled => false,
        }
    }
}

/// What a ray gathers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// Emission and absorption by the transfer function.
    #[default]
    Composite,
    /// Length inside the mesh, in file units.
    Thickness,
    /// The largest scalar on the ray, grey: black at the low end of the geometry's range of
    /// scalars, white at the high one.
    Maximum,
    /// The least.
    Minimum,
    /// The mean over the length inside the mesh.
    Mean,
    /// What attenuates X-rays on the way, ∫ μ dl, by [`RaycastOptions::xray`]: of mass that a
    /// deformation moves and does not make.
    Xray,
}

/// What the shaders can gather: [`Mode`], or counts for a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Integrand {
    Composite,
    /// The same, each way through the mesh also by itself.
    Intervals,
    Thickness,
    Statistics,
    Maximum,
    Minimum,
    Mean,
    Xray,
}

impl Integrand {
    /// Its number in `lib/segment.wgsl`.
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

    /// Whether it is emission and absorption.
    pub fn is_composite(self) -> bool {
        matches!(self, Integrand::Composite | Integrand::Intervals)
    }

    /// Whether it is a scalar's projection.
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

/// Choices that a raycaster is made with; see [`RaycastOptions::for_tolerance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaycastOptions {
    /// How rays walk.
    pub walk: Traversal,
    /// How they read the mesh.
    pub reads: MeshAccess,
    /// How segments are looked up.
    pub table: TableKind,
    /// What the table's values are held in.
    pub texel: TableTexel,
    /// Texels of the table along each scalar, and layers of a [`TableKind::Volume`]; chosen for
    /// `table_tolerance` where nothing is said.
    pub table_size: Option<u32>,
    /// A ray of more than this opacity is not followed further; 1 follows each to its end.
    pub opacity_cutoff: f64,
    /// Most times a ray may enter the mesh (`--layers`).
    pub layers: u32,
    /// Error of a picture's values that the table's size is chosen for.
    pub table_tolerance: f64,
    /// The light on the inside, in [`Mode::Composite`]. The geometry has to be made ready for it
    /// ([`Geometry::enable_lighting`](super::Geometry::enable_lighting)).
    pub light: Light,
    /// How dark the light is where the body keeps it off, from 0, which takes no time, to 1: soft
    /// shadows of a light that stands; by the light of the eye, how little of the sky a place sees.
    pub shadows: f64,
    /// Voxels between two samples of a [`Scan`](super::Scan) at most, from 1/64 to 1.
    pub scan_step: f64,
    /// The source, and what CT numbers stand for, of [`Mode::Xray`].
    pub xray: Xray,
}

impl RaycastOptions {
    pub(super) fn check(&self, gpu: &Gpu) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        if !(1..=255).contains(&self.layers) {
            return wrong(format!(
                "{} layers: choose from 1 to 255 (--layers)",
                self.layers
            ));
        }
        if !(self.opacity_cutoff > 0.0 && self.opacity_cutoff <= 1.0) {
            return wrong(format!(
                "rays cannot end at an opacity of {}: choose above 0, and up to 1",
                self.opacity_cutoff
            ));
        }
        if !(self.table_tolerance > 0.0 && self.table_tolerance.is_finite()) {
            return wrong(format!(
                "an accuracy of {} cannot be met: choose above 0, of a range from 0 to 1",
                self.table_tolerance
            ));
        }
        self.light.check()?;
        self.xray.check()?;
        if !(0.0..=1.0).contains(&self.shadows) {
            return wrong(format!(
                "shadows of {}: choose from 0, for none, to 1",
                self.shadows
            ));
        }
        if !(1.0 / 64.0..=1.0).contains(&self.scan_step) {
            return wrong(format!(
                "samples of a scan {} voxels apart: choose from 1/64 to 1",
                self.scan_step
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
    /// Depths (`Depth32Float`, drawn with [`clip_from_file`](super::Raycaster::file_to_clip)) of opaque things that
    /// hide what lies behind them.
    pub depth: Option<&'a wgpu::TextureView>,
    /// What was there before is replaced by this colour (red, green, blue, opacity) under the
    /// picture; without one, the picture is blended over it.
    pub background: Option<[f32; 4]>,
}

/// What the rays of a picture met.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RaycastReport {
    /// Pixels whose ray meets the mesh.
    pub rays: u64,
    /// Rays not followed to their end; none, unless tets are inverted. Known are walks that end
    /// neither at the boundary nor opaque, and rays that enter the mesh (or begin in it) more or
    /// less often than they leave it: one that should have started and did not; a ray of both
    /// kinds counts twice. Not known is a ray for which the rasteriser missed as many ways in as
    /// ways out.
    pub lost_rays: u64,
    /// Tets that a ray passes, on average.
    pub tets_per_ray: f64,
    /// Most times a ray enters the mesh.
    pub peel_layers: u32,
    /// Tets that are inside out or flat.
    pub inverted: u32,
}
