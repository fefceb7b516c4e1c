//! Merging of small face-connected components of a region (islands) into their neighbours.

use super::stencil::Piece;
use crate::Result;
use crate::mesh::{DisjointSets, FACES, signed_volume};
use crate::parallel;
use crate::progress::ProgressScope;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;
use std::collections::BTreeMap;

/// The islands of one region.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct IslandReport {
    /// The region, from 1 on.
    pub region: u16,
    /// Their number.
    pub islands: usize,
    /// Their volume.
    pub volume: f64,
}

/// Merges every component of a region smaller than `least` into the neighbour with which it shares
/// the largest area, the smallest component first. Components merged into the outside are dropped.
pub(super) fn merge_small_components(
    nodes: &[DVec3],
    pieces: &mut [Piece],
    least: f64,
    part: &ProgressScope,
) -> Result<Vec<IslandReport>> {
    let mut reports: BTreeMap<u16, IslandReport> = BTreeMap::new();
    if least > 0.0 {
        // Merged islands may still be small.
        while dissolve_once(nodes, pieces, least, &mut reports) {
            part.check_cancelled()?;
        }
    }
    Ok(reports.into_values().collect())
}

/// Runs one round over the current islands; returns false if there are none. Long because one
/// round collects faces, groups, walls and merges, which share all of their data.
fn dissolve_once(
    nodes: &[DVec3],
    pieces: &mut [Piece],
    least: f64,
    reports: &mut BTreeMap<u16, IslandReport>,
) -> bool {
    let mut faces = parallel::collect(pieces.len(), |range, faces| {
        for t in range {
            faces.extend(FACES.map(|f| {
                let mut face = f.map(|i| pieces[t].0[i]);
                face.sort_unstable();
                (face, t as u32)
            }));
        }
    });
    faces.par_sort_unstable();
    let mut groups = DisjointSets::new(pieces.len());
    // Faces between two regions, or between a region and the outside beyond the tets.
    let mut walls: Vec<(u32, Option<u32>, f64)> = Vec::new();
    for same in faces.chunk_by(|a, b| a.0 == b.0) {
        let [a, b, c] = same[0].0.map(|v| nodes[v as usize]);
        let area = 0.5 * (b - a).cross(c - a).length();
        match same {
            [(_, t), (_, u)] if pieces[*t as usize].1 == pieces[*u as usize].1 => {
                groups.union(*t, *u);
            }
            [(_, t), (_, u)] => walls.push((*t, Some(*u), area)),
            _ => walls.extend(same.iter().map(|s| (s.1, None, area))),
        }
    }
    drop(faces);
    let mut volume: BTreeMap<u32, f64> = BTreeMap::new();
    for (t, (tet, region)) in pieces.iter().enumerate() {
        if *region != 0 {
            let own = signed_volume(tet.map(|v| nodes[v as usize]));
            *volume.entry(groups.find(t as u32)).or_default() += own;
        }
    }
    let mut small: Vec<(f64, u32)> = volume
        .iter()
        .filter(|v| *v.1 < least)
        .map(|(group, volume)| (*volume, *group))
        .collect();
    small.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut beside: BTreeMap<u32, Vec<(Option<u32>, f64)>> =
        small.iter().map(|s| (s.1, Vec::new())).collect();
    for (t, u, area) in walls {
        let ends = [Some(t), u].map(|t| t.map(|t| groups.find(t)));
        for [own, other] in [ends, [ends[1], ends[0]]] {
            if let Some(list) = own.and_then(|own| beside.get_mut(&own)) {
                list.push((other, area));
            }
        }
    }
    // Components are merged as they change region; the region of a component is that of its first
    // tet.
    let mut region_of: BTreeMap<u32, u16> = BTreeMap::new();
    for (own_volume, group) in small {
        let now = groups.find(group);
        if now != group || volume.get(&group).is_none_or(|v| *v >= least) {
            continue;
        }
        let mut areas: BTreeMap<u16, (f64, Vec<u32>)> = BTreeMap::new();
        for (other, area) in beside.get(&group).into_iter().flatten() {
            let other = other.map(|o| groups.find(o));
            let region = other.map_or(0, |o| {
                region_of.get(&o).copied().unwrap_or(pieces[o as usize].1)
            });
            if other == Some(group) {
                continue;
            }
            let entry = areas.entry(region).or_default();
            entry.0 += area;
            entry.1.extend(other);
        }
        let largest = areas
            .into_iter()
            .max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0)));
        let Some((region, (_, others))) = largest else {
            continue;
        };
        let own_region = pieces[group as usize].1;
        let entry = reports.entry(own_region).or_default();
        entry.region = own_region;
        entry.islands += 1;
        entry.volume += own_volume;
        region_of.insert(group, region);
        let sum = own_volume
            + others
                .iter()
                .collect::<std::collections::BTreeSet<_>>()
                .into_iter()
                .filter_map(|o| volume.get(o))
                .sum::<f64>();
        for other in others {
            groups.union(group, other);
        }
        let merged = groups.find(group);
        region_of.insert(merged, region);
        volume.insert(merged, sum);
    }
    for (t, piece) in pieces.iter_mut().enumerate() {
        if let Some(region) = region_of.get(&groups.find(t as u32)) {
            piece.1 = *region;
        }
    }
    !region_of.is_empty()
}
