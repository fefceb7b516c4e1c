//! Iterative offsets of weights so that regions have their true volumes.

use super::domain::RegionVolume;
use super::stencil::Piece;
use crate::mesh::signed_volume;
use glam::DVec3;

/// Relative tolerance of the volume of a region.
const VOLUME_TOLERANCE: f64 = 0.005;

/// Maximum offset of a weight: if parts of a region are below the resolution of the lattice, the
/// rest must not be inflated to compensate.
const MAX_OFFSET: f64 = 0.2;

/// Updates `added`, the offsets of the weights of regions 1, 2, …, for the next iteration; returns
/// false if all volumes are within the tolerance.
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
