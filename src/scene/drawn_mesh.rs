//! The mesh that pictures show in place of the simulated one, whose regions have smooth boundaries.

use super::picture::DisplayMode;
use super::stage::NodeSource;
use super::{ScalarField, Scene, Unit};
use crate::Result;
use crate::cage::Embedding;
use crate::gpu::{Gpu, Recorder};
use crate::io::{self, Kind};
use crate::mesh::{BarycentricMap, LabelShares, SmoothRegions, TetMesh, Topology};
use crate::physics::{BodyField, NodePositions};
use crate::render::{Geometry, Mode, Scalars};
use crate::volume::Volume;
use glam::DVec3;

/// Largest number of tets of a mesh whose boundaries are smoothed: those of larger ones are fine already.
const MAX_TETS: usize = 150_000;
/// Distance of the samples around a point, relative to the length of edges there.
const SAMPLE_DISTANCE: f64 = 0.28;

/// A mesh for pictures, carried by the nodes of the body.
pub(super) struct DrawnMesh {
    pub mesh: TetMesh,
    pub topology: Topology,
    pub embedding: Embedding,
    /// The body's own mesh, for picks.
    pub picker: Geometry,
}

impl Scene {
    /// Returns the mesh to draw for the body of `drive` with smooth boundaries between regions; `None` if
    /// the picture shows no regions, or boundaries along the faces of tets are wanted.
    ///
    /// # Errors
    /// Errors of reading the label volume again, and of the device.
    pub(super) fn drawn_mesh(&self, gpu: &Gpu, drive: &NodeSource) -> Result<Option<DrawnMesh>> {
        let mesh = drive.mesh();
        let mode = self.display_mode()?;
        let shown = matches!(
            mode,
            DisplayMode::Inside(Mode::Composite) | DisplayMode::Surface
        );
        let computed = self
            .picture
            .field
            .as_ref()
            .is_some_and(|f| f.parse::<BodyField>().is_ok());
        let split = !(self.cut.is_empty() && self.scan.is_empty()) || self.grid.is_some();
        if !shown || split || computed {
            return Ok(None);
        }
        let Some(field) = mesh.region_field() else {
            return Ok(None);
        };
        let named = self
            .picture
            .field
            .as_ref()
            .or(self.picture.transfer.as_ref());
        let shows = match &self.picture.field {
            Some(name) => *name == field.name,
            None => named.is_none(),
        };
        if !(shows || self.picture.has_region_appearance()) {
            return Ok(None);
        }
        let smooth = self.smooth_regions(mesh)?;
        let Some(SmoothRegions {
            mesh: drawn,
            weights,
        }) = smooth
        else {
            return Ok(None);
        };
        let carriers = drive.nodes();
        let map = BarycentricMap::from_weights(mesh.nodes.len(), weights);
        let mut embedding = Embedding::with_transfer(gpu, map, carriers, &drawn)?;
        // The body may be deformed already.
        embedding.invalidate();
        let zeros = vec![0.0; mesh.nodes.len()];
        let scalars = Scalars::Nodes(&zeros);
        let (frame, positions) = (carriers.frame(), carriers.array());
        let picker = Geometry::new(gpu, mesh, drive.topology(), frame, positions, scalars)?;
        Ok(Some(DrawnMesh {
            topology: Topology::new(&drawn),
            mesh: drawn,
            embedding,
            picker,
        }))
    }

    /// Returns `mesh`, at rest, with smooth boundaries between its regions; `None` if it has none, or too
    /// many tets, or the scene asks for boundaries along the faces of tets.
    ///
    /// # Errors
    /// Errors of reading the label volume again.
    pub(crate) fn smooth_regions(&self, mesh: &TetMesh) -> Result<Option<SmoothRegions>> {
        let by_tets = self.picture.boundaries.as_deref() == Some("tets");
        let field = mesh
            .region_field()
            .filter(|_| !by_tets && mesh.tets.len() <= MAX_TETS);
        let Some(field) = field else {
            return Ok(None);
        };
        let Some((volume, units_per_mm)) = self.label_volume(mesh)? else {
            return mesh.with_smooth_regions(field, None).map(Some);
        };
        let to_voxels = volume.to_world.inverse();
        let to_voxels = |q: DVec3| to_voxels.transform_point3(q / units_per_mm);
        let shares =
            |p: DVec3, edge: f64| label_shares(&volume, to_voxels, p, SAMPLE_DISTANCE * edge);
        let axes = volume.to_world.matrix3;
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis];
        let sides = axes.map(|axis| axis.length() * units_per_mm);
        let volume = LabelShares {
            shares: &shares,
            voxel: sides.into_iter().fold(f64::INFINITY, f64::min),
        };
        mesh.with_smooth_regions(field, Some(volume)).map(Some)
    }

    /// Returns the label volume that the mesh was made from, and mesh units per mm; `None` for other
    /// meshes.
    fn label_volume(&self, mesh: &TetMesh) -> Result<Option<(Volume, f64)>> {
        let (Some(file), true) = (&self.mesh.file, self.mesh.labels.is_some()) else {
            return Ok(None);
        };
        if self.body.len() + self.mesh.join.len() > 0 || io::detect_kind(file)? != Kind::Volume {
            return Ok(None);
        }
        let volume = io::read_volume_number(file, self.mesh.volume)?;
        let unit = self.mesh.unit.as_ref().map(Unit::metres).transpose()?;
        let units_per_mm = 1e-3 / unit.or(mesh.length_unit).unwrap_or(1e-3);
        Ok(Some((volume, units_per_mm)))
    }
}

/// Returns the mean shares of the labels of `volume` at 27 points around `p`, `step` apart: each is
/// interpolated between the voxels, and beyond the volume is none.
fn label_shares(
    volume: &Volume,
    to_voxels: impl Fn(DVec3) -> DVec3,
    p: DVec3,
    step: f64,
) -> Vec<(i64, f64)> {
    let mut shares: Vec<(i64, f64)> = Vec::new();
    let offsets = [-1.0, 0.0, 1.0];
    for (x, y, z) in triples(offsets) {
        let q = to_voxels(p + step * DVec3::new(x, y, z));
        let low = q.floor();
        let part = q - low;
        for corner in 0..8 {
            let at = [0, 1, 2].map(|k| low[k] as i64 + i64::from((corner >> k) & 1 == 1));
            let weight: f64 = (0..3)
                .map(|k| {
                    if (corner >> k) & 1 == 1 {
                        part[k]
                    } else {
                        1.0 - part[k]
                    }
                })
                .product();
            let inside = (0..3).all(|k| at[k] >= 0 && at[k] < volume.size[k] as i64);
            if weight <= 0.0 || !inside {
                continue;
            }
            let n = at[0] as usize
                + volume.size[0] * (at[1] as usize + volume.size[1] * at[2] as usize);
            let label = volume.value(n) as i64;
            match shares.iter_mut().find(|s| s.0 == label) {
                Some(own) => own.1 += weight / 27.0,
                None => shares.push((label, weight / 27.0)),
            }
        }
    }
    shares
}

/// Returns all triples of three numbers.
fn triples(of: [f64; 3]) -> impl Iterator<Item = (f64, f64, f64)> {
    (0..27).map(move |k| (of[k % 3], of[k / 3 % 3], of[k / 9]))
}

impl DrawnMesh {
    /// Sets the values at the nodes of regions that are drawn to labels, for the boundary.
    pub fn label_nodes(drawn: Option<&DrawnMesh>, scalars: &mut ScalarField) {
        if let (Some(drawn), Some(cells)) = (drawn, &scalars.cells)
            && !scalars.regions.is_empty()
        {
            scalars.values = drawn.node_labels(cells);
        }
    }

    /// Returns the label of the largest part of the surroundings of each node, given that of each tet:
    /// means of labels would be other labels.
    fn node_labels(&self, cells: &[f64]) -> Vec<f64> {
        let mut volumes: Vec<Vec<(f64, f64)>> = vec![Vec::new(); self.mesh.nodes.len()];
        for (t, (tet, label)) in self.mesh.tets.iter().zip(cells).enumerate() {
            let volume = self.mesh.tet_volume(t).abs();
            for v in tet {
                let own = &mut volumes[*v as usize];
                match own.iter_mut().find(|s| s.0 == *label) {
                    Some(own) => own.1 += volume,
                    None => own.push((*label, volume)),
                }
            }
        }
        let largest = |own: &Vec<(f64, f64)>| {
            let best = own
                .iter()
                .copied()
                .reduce(|a, b| if b.1 > a.1 { b } else { a });
            best.map_or(0.0, |best| best.0)
        };
        volumes.iter().map(largest).collect()
    }

    /// Returns the positions of the drawn nodes.
    pub fn nodes(&self) -> &NodePositions {
        self.embedding.nodes()
    }

    /// Records the update of the drawn nodes from those of the body.
    pub fn follow(&mut self, work: &mut Recorder, carriers: &NodePositions) {
        self.embedding.record_update(work, carriers);
    }
}
