//! Weights raised or lowered until regions have their true volumes.

use super::domain::RegionVolume;
use super::stencil::Piece;
use crate::mesh::signed_volume;
use glam::DVec3;

/// Regions whose volume is as near as this to the true one are near enough.
const VOLUME_TOLERANCE: f64 = 0.005;

/// The most that is added to or taken from a weight: where whole parts of a region slip through
/// the lattice, the rest is not to be blown up for them.
const MAX_OFFSET: f64 = 0.2;

/// Changes `added`, what is added to the weights of regions 1, 2, …, for the next try; false when
/// all volumes are near enough.
pub(super) fn correct_region_volumes(
    truth: &[RegionVolume],
    nodes: &[DVec3],
    pieces: &[Piece],
    added: &mut Vec<f64>,
) -> bool {
    added.resize(truth.len(), 0.0);
    let mut volumes = vec![0.0; truth.len()];
    for (tet, region) in pieces {
        let place = usize::from(*region).checked_sub(1);
        if let Some(volume) = place.and_then(|r| volumes.get_mut(r)) {
            *volume += signed_volume(tet.map(|v| nodes[v as usize]));
        }
    }
    let mut changed = false;
    for ((truth, volume), added) in truth.iter().zip(volumes).zip(added) {
        let lacks = truth.volume - volume;
        if lacks.abs() > VOLUME_TOLERANCE * truth.volume && truth.area > 0.0 {
            let next = (*added + lacks / truth.area).clamp(-MAX_OFFSET, MAX_OFFSET);
            changed |= next != *added;
            *added = next;
        }
    }
    changed
}
