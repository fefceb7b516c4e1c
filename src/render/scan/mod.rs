//! Scans that a body carries: looked up, at full resolution, where each point of a ray is when the
//! body rests. A body of a few tets so shows millions of voxels bent.
//!
//! Inside a tet the way from where a point is to where it rests is affine, so a ray that is straight
//! where the body is is straight at rest too, tet by tet. It is sampled there at most a voxel apart
//! ([`texture`]), and what lies between two samples is looked up in the table of integrals; lengths
//! are those of the deformed body. Gradients for light are differences of the scan, carried by F⁻ᵀ.
//! The twin of `shaders/terms/scan.wgsl`.

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

/// Scans of a picture, at most.
pub const MAX_SCANS: usize = 8;

/// A volume that a body carries, and what it looks like.
#[derive(Clone, Debug)]
pub struct Scan {
    /// The voxels, placed where the body rests: in RAS mm.
    pub volume: Arc<Volume>,
    /// Units of the mesh in a millimetre: 1 for a mesh in mm.
    pub units_per_mm: f64,
    /// What is seen of it.
    pub appearance: ScanAppearance,
}

/// What is seen of a [`Scan`].
#[derive(Clone, Debug)]
pub enum ScanAppearance {
    /// Its values, trilinear between voxels.
    Values {
        /// What shows them. Extinction is per unit of the mesh.
        transfer: TransferFunction,
        /// Smallest and largest value, which stand for what is beyond them; those that occur where
        /// nothing is said.
        range: Option<(f64, f64)>,
    },
    /// Labels, each voxel the one it has; those that are not here are not seen.
    Labels(BTreeMap<i64, LabelAppearance>),
}

impl Scan {
    /// From places at rest, in units of the mesh, to voxels.
    pub fn rest_to_voxel(&self) -> DAffine3 {
        let from_mm = DAffine3::from_scale(glam::DVec3::splat(self.units_per_mm));
        (from_mm * self.volume.to_world).inverse()
    }

    /// Smallest and largest value that are told apart.
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

    /// Whether numbers make sense, and the scan lies where `mesh` rests.
    pub(super) fn check(&self, mesh: &TetMesh) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        if !(self.units_per_mm.is_finite() && self.units_per_mm > 0.0) {
            return wrong(format!(
                "a scan has {} units of the mesh in a millimetre: a positive number is expected",
                self.units_per_mm
            ));
        }
        match &self.appearance {
            ScanAppearance::Values {
                range: Some((low, high)),
                ..
            } if !(low < high && (high - low).is_finite()) => {
                return wrong(format!(
                    "a range of a scan from {low} to {high} makes no sense; give a smaller and a larger number"
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
                "the scan lies from {from:.1} to {to:.1}, in units of the mesh, and the body, at rest, from {low:.1} to {high:.1}: they do not meet. A scan is placed by its own header (RAS, mm); mesh the same scan with `palpate mesh`, or state the mesh's unit"
            ));
        }
        Ok(())
    }
}
