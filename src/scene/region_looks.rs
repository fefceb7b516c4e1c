//! What each region of a picture looks like, where the scene says so.

use super::{RegionLookEntry, Scene};
use crate::mesh::{FACES, LocalFrame, NO_NEIGHBOUR, TetMesh, Topology};
use crate::render::{RegionLooks, TransferFunction, named_colour};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// The opacity of a ray's mean way through a region that has a colour, and no opacity, of its own.
const OPACITY: f64 = 0.9;
/// What a region of opacity 1 lets through.
const CLEAR: f64 = 1e-4;

impl Scene {
    /// What the regions that `[picture.region]` and `[picture] hide` name look like, and all else by
    /// `transfer`; none where they name nothing.
    pub(super) fn region_looks(
        &self,
        mesh: &TetMesh,
        topology: &Topology,
        transfer: &TransferFunction,
    ) -> Result<Option<RegionLooks>> {
        let (entries, hide) = (&self.picture.region, &self.picture.hide);
        if entries.is_empty() && hide.is_empty() {
            return Ok(None);
        }
        let Some(field) = mesh.region_field() else {
            return Err(Error::Input(
                "[picture.region] and hide (--hide) name regions of the mesh, and it has none: no cell field of whole numbers says them".into(),
            ));
        };
        let labels: Vec<i64> = field.values.iter().map(|v| *v as i64).collect();
        let mut transfers = vec![transfer.clone()];
        let mut looks: BTreeMap<i64, Option<u32>> = BTreeMap::new();
        for name in hide {
            looks.insert(label(mesh, &labels, name)?, None);
        }
        for (name, entry) in entries {
            let label = label(mesh, &labels, name)?;
            if looks.contains_key(&label) {
                continue;
            }
            let region = (mesh, topology, labels.as_slice(), label);
            let own = match entry.hidden {
                true => None,
                false => {
                    let own = entry.made(self, transfer, region);
                    let named = |e| Error::Input(format!("[picture.region.{name}]: {e}"));
                    transfers.push(own.map_err(named)?);
                    Some(transfers.len() as u32 - 1)
                }
            };
            looks.insert(label, own);
        }
        let look = |label: &i64| looks.get(label).copied().unwrap_or(Some(0));
        Ok(Some(RegionLooks {
            of_tets: labels.iter().map(look).collect(),
            transfers,
        }))
    }
}

impl RegionLookEntry {
    /// What it makes of the picture's own transfer function.
    fn made(
        &self,
        scene: &Scene,
        own: &TransferFunction,
        (mesh, topology, labels, label): (&TetMesh, &Topology, &[i64], i64),
    ) -> Result<TransferFunction> {
        let mut shown = match &self.transfer {
            Some(named) => scene.named_transfer(named)?,
            None => own.clone(),
        };
        if let Some(colour) = &self.colour {
            shown = shown.coloured(named_colour(colour)?);
        }
        let opacity = match (&self.transfer, &self.colour) {
            (None, Some(_)) => self.opacity.or(Some(OPACITY)),
            _ => self.opacity,
        };
        let Some(opacity) = opacity else {
            return Ok(shown);
        };
        if !(0.0..=1.0).contains(&opacity) {
            return Err(Error::Input(format!(
                "opacity = {opacity}: what a ray's mean way through the region hides, from 0 to 1, is expected"
            )));
        }
        let way = mean_way(mesh, topology, labels, label).max(f64::MIN_POSITIVE);
        let extent = LocalFrame::of_mesh(mesh).scale;
        Ok(shown.as_dense((1.0 - opacity).max(CLEAR).ln().abs() / way, extent))
    }
}

/// The label of the region that is named, or given by its label; it has tets.
fn label(mesh: &TetMesh, labels: &[i64], name: &str) -> Result<i64> {
    let label = mesh.region_label(name)?;
    match labels.contains(&label) {
        true => Ok(label),
        false => Err(Error::Input(format!(
            "no tet of the mesh is of region {name}; `palpate info` lists the regions"
        ))),
    }
}

/// The mean way of a ray through a region of volume V and surface S: 4V/S (Cauchy).
fn mean_way(mesh: &TetMesh, topology: &Topology, labels: &[i64], label: i64) -> f64 {
    let (mut volume, mut surface) = (0.0, 0.0);
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        if labels[t] != label {
            continue;
        }
        volume += mesh.tet_volume(t).abs();
        for (face, neighbour) in FACES.iter().zip(neighbours) {
            if *neighbour != NO_NEIGHBOUR && labels[*neighbour as usize / 4] == label {
                continue;
            }
            let [a, b, c] = face.map(|i| mesh.nodes[mesh.tets[t][i] as usize]);
            surface += 0.5 * (b - a).cross(c - a).length();
        }
    }
    4.0 * volume / f64::max(surface, f64::MIN_POSITIVE)
}
