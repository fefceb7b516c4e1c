//! Appearance of individual regions in a picture.

use super::{RegionAppearanceEntry, Scene};
use crate::mesh::{FACES, LocalFrame, NO_NEIGHBOUR, TetMesh, Topology};
use crate::render::{RegionAppearance, TransferFunction, named_colour};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Default opacity over the mean chord length of a region that has a colour.
const OPACITY: f64 = 0.9;
/// Transmittance of a region of opacity 1.
const MIN_TRANSMITTANCE: f64 = 1e-4;

impl Scene {
    /// Returns the appearance of the regions in `[picture.region]` and `[picture] hide`, with
    /// `transfer` for all others; `None` without such regions.
    pub(super) fn region_looks(
        &self,
        mesh: &TetMesh,
        topology: &Topology,
        transfer: &TransferFunction,
    ) -> Result<Option<RegionAppearance>> {
        if !self.picture.has_region_appearance() {
            return Ok(None);
        }
        let regions = mesh.region_field().map(|field| {
            let labels: Vec<i64> = field.values.iter().map(|v| *v as i64).collect();
            let chord_lengths = mean_chords(mesh, topology, &labels);
            (labels, chord_lengths)
        });
        let extent = LocalFrame::from_mesh(mesh).scale;
        let looks = self.region_appearances(mesh, regions, extent, transfer)?;
        Ok(Some(looks))
    }

    /// As [`Scene::region_looks`] for a whole mesh or a piece, given the label of each tetrahedron,
    /// the mean chord length of rays through each region of the whole mesh, and the extent of the
    /// whole mesh.
    pub(super) fn region_appearances(
        &self,
        mesh: &TetMesh,
        regions: Option<(Vec<i64>, BTreeMap<i64, f64>)>,
        extent: f64,
        transfer: &TransferFunction,
    ) -> Result<RegionAppearance> {
        let (entries, hide) = (&self.picture.region, &self.picture.hide);
        let Some((labels, chord_lengths)) = regions else {
            return Err(Error::Input(
                "[picture.region] and hide (--hide) require regions, but the mesh has no cell field of integer region labels".into(),
            ));
        };
        let mut transfers = vec![transfer.clone()];
        let mut looks: BTreeMap<i64, Option<u32>> = BTreeMap::new();
        for name in hide {
            looks.insert(label(mesh, &chord_lengths, name)?.0, None);
        }
        for (name, entry) in entries {
            let (label, chord_length) = label(mesh, &chord_lengths, name)?;
            if looks.contains_key(&label) {
                continue;
            }
            let own = match entry.hidden {
                true => None,
                false => {
                    let own = entry.made(self, transfer, (chord_length, extent));
                    let named = |e| Error::Input(format!("[picture.region.{name}]: {e}"));
                    transfers.push(own.map_err(named)?);
                    Some(transfers.len() as u32 - 1)
                }
            };
            looks.insert(label, own);
        }
        let look = |label: &i64| looks.get(label).copied().unwrap_or(Some(0));
        Ok(RegionAppearance {
            tet_regions: labels.iter().map(look).collect(),
            transfers,
        })
    }
}

impl RegionAppearanceEntry {
    /// Returns the transfer function of the region, derived from that of the picture.
    fn made(
        &self,
        scene: &Scene,
        own: &TransferFunction,
        (chord_length, extent): (f64, f64),
    ) -> Result<TransferFunction> {
        let mut shown = match &self.transfer {
            Some(named) => scene.named_transfer(named)?,
            None => own.clone(),
        };
        if let Some(colour) = &self.colour {
            shown = shown.with_colour(named_colour(colour)?);
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
                "opacity (over the mean chord length of the region) must be in [0, 1], got {opacity}"
            )));
        }
        let chord_length = chord_length.max(f64::MIN_POSITIVE);
        Ok(shown.with_constant_extinction(
            (1.0 - opacity).max(MIN_TRANSMITTANCE).ln().abs() / chord_length,
            extent,
        ))
    }
}

/// Returns the label of a region given by name or label, and its mean chord length; an error if it
/// has no tetrahedra.
fn label(mesh: &TetMesh, chord_lengths: &BTreeMap<i64, f64>, name: &str) -> Result<(i64, f64)> {
    let label = mesh.region_label(name)?;
    match chord_lengths.get(&label) {
        Some(chord_length) => Ok((label, *chord_length)),
        None => Err(Error::Input(format!(
            "region {name} has no tets; list the regions with `palpate info`"
        ))),
    }
}

/// Returns the mean chord length of rays through each region of volume V and surface S: 4V/S
/// (Cauchy).
pub(super) fn mean_chords(
    mesh: &TetMesh,
    topology: &Topology,
    labels: &[i64],
) -> BTreeMap<i64, f64> {
    let mut sums: BTreeMap<i64, [f64; 2]> = BTreeMap::new();
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        let [volume, surface] = sums.entry(labels[t]).or_default();
        *volume += mesh.tet_volume(t).abs();
        for (face, neighbour) in FACES.iter().zip(neighbours) {
            if *neighbour != NO_NEIGHBOUR && labels[*neighbour as usize / 4] == labels[t] {
                continue;
            }
            let [a, b, c] = face.map(|i| mesh.nodes[mesh.tets[t][i] as usize]);
            *surface += 0.5 * (b - a).cross(c - a).length();
        }
    }
    let chord_length =
        |[volume, surface]: [f64; 2]| 4.0 * volume / f64::max(surface, f64::MIN_POSITIVE);
    sums.into_iter()
        .map(|(label, sums)| (label, chord_length(sums)))
        .collect()
}
