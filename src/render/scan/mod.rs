//! Scans (voxel volumes) attached to a body and sampled at full resolution at the rest position of
//! each ray point. A body of few tets thus shows millions of voxels in deformed space.
//!
//! The map from deformed to rest positions is affine in each tet, so a ray is straight at rest
//! within each tet. It is sampled there at most one voxel apart ([`texture`]), and the interval
//! between two samples is looked up in the table of integrals; lengths are those of the deformed
//! body. Gradients for lighting are finite differences of the scan, transformed by F⁻ᵀ. Reference
//! of `shaders/terms/scan.wgsl`.

mod labels;
mod min_max_pyramid;
mod reference;
mod scan_set;
mod texture;

pub use labels::LabelAppearance;
pub(super) use reference::ScanReference;
pub(super) use scan_set::ScanSet;

use super::TransferFunction;
use crate::mesh::TetMesh;
use crate::volume::Volume;
use crate::{Error, Result};
use glam::DAffine3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Maximum number of scans in an image.
pub(crate) const MAX_SCANS: usize = 8;

/// A volume attached to a body, and its appearance.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Voxels, positioned in the rest configuration in RAS mm.
    pub volume: Arc<Volume>,
    /// Mesh length units per millimetre: 1 for a mesh in mm.
    pub units_per_mm: f64,
    /// Whether to show values or labels.
    pub appearance: ScanAppearance,
}

/// Appearance of a [`Scan`].
#[derive(Clone, Debug)]
pub enum ScanAppearance {
    /// Values, interpolated trilinearly between voxels.
    Values {
        /// Transfer function; extinction is per length unit of the mesh.
        transfer: TransferFunction,
        /// Smallest and largest displayed value, to which others are clamped; `None` uses the range
        /// of the volume.
        range: Option<(f64, f64)>,
    },
    /// Labels, nearest-neighbour sampled; labels that are not listed are not shown.
    Labels(BTreeMap<i64, LabelAppearance>),
}

impl Scan {
    /// Returns the transform from rest positions, in mesh units, to voxel indices.
    pub fn rest_to_voxel(&self) -> DAffine3 {
        let from_mm = DAffine3::from_scale(glam::DVec3::splat(self.units_per_mm));
        (from_mm * self.volume.to_world).inverse()
    }

    /// Returns the displayed value range; its width is 1 for constant values.
    pub fn range(&self) -> (f64, f64) {
        let given = match &self.appearance {
            ScanAppearance::Values { range, .. } => *range,
            ScanAppearance::Labels(_) => None,
        };
        let (low, high) = given.or_else(|| self.volume.range()).unwrap_or((0.0, 1.0));
        match low < high {
            true => (low, high),
            false => (low, low + 1.0),
        }
    }

    /// Checks the parameters, and that the scan overlaps the rest configuration of `mesh`.
    pub(super) fn check(&self, mesh: &TetMesh) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        if !(self.units_per_mm.is_finite() && self.units_per_mm > 0.0) {
            return wrong(format!(
                "mesh units per millimetre of a scan must be positive and finite, got {}",
                self.units_per_mm
            ));
        }
        match &self.appearance {
            ScanAppearance::Values {
                range: Some((low, high)),
                ..
            } if !(low < high && (high - low).is_finite()) => {
                return wrong(format!(
                    "value range of a scan must be finite and increasing, got {low} to {high}"
                ));
            }
            ScanAppearance::Labels(looks) => {
                looks.iter().try_for_each(|(l, look)| look.check(*l))?
            }
            ScanAppearance::Values { .. } => {}
        }
        let to_voxel = self.rest_to_voxel();
        let last = self.volume.size.map(|n| n as f64 - 0.5);
        let covered = mesh.tets.iter().any(|tet| {
            let corners = tet.map(|v| to_voxel.transform_point3(mesh.nodes[v as usize]));
            let (low, high) = crate::mesh::bounds(&corners);
            (0..3).all(|k| high[k] > -0.5 && low[k] < last[k])
        });
        if !covered {
            let scan = self.volume.bounds();
            let (low, high) = mesh.bounds();
            let [from, to] = [scan.0, scan.1].map(|p| p * self.units_per_mm);
            return wrong(format!(
                "the scan ({from:.1} to {to:.1} in mesh units) and the body at rest ({low:.1} to {high:.1}) do not overlap; the header of the scan sets its position (RAS, mm): mesh the same scan with `palpate mesh`, or set the mesh's unit"
            ));
        }
        Ok(())
    }
}
