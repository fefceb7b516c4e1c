//! Repair of non-manifold edges and nodes (pinches) of the boundary of the body or of a region.
//!
//! First, tets around them are assigned to other regions, the smaller fan to its surroundings, as
//! long as this reduces the number of pinches; the outside takes part with the tets along the
//! boundary. Remaining pinches of the body's own boundary are split: a node at which the body has
//! several fans is duplicated for each, and if the outside has several fans, the tets at the node
//! are removed.

use super::fans::VertexFans;
use super::stars::Stars;
use super::stencil::Piece;
use crate::Result;
use crate::mesh::signed_volume;
use crate::parallel;
use crate::progress::ProgressScope;
use glam::DVec3;
use std::collections::VecDeque;

/// Weight of a pinch of the body's own boundary relative to one between regions.
const OUTER_BOUNDARY_WEIGHT: usize = 100;

/// Number of pinches between two checks for cancellation.
const CANCEL_CHECK_INTERVAL: usize = 256;

/// Statistics of the repair of pinches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct NonManifoldReport {
    /// Nodes at which the boundary of the body or a region was non-manifold.
    pub found: usize,
    /// Tets assigned to another region or the outside, or added.
    #[serde(rename = "relabelled")]
    pub relabelled_tets: usize,
    /// Nodes duplicated to separate parts of the body that met in them.
    #[serde(rename = "doubled")]
    pub duplicated_nodes: usize,
    /// Nodes at which a region is still non-manifold; the boundary of the whole body never is.
    pub left: usize,
}

/// Repairs pinches as described in the module. `pieces` must contain the tets outside along the
/// boundary; afterwards it contains only those inside.
pub(super) fn repair_non_manifold(
    nodes: &mut Vec<DVec3>,
    pieces: &mut Vec<Piece>,
    watch: &ProgressScope,
) -> Result<NonManifoldReport> {
    let mut report = NonManifoldReport::default();
    let stars = Stars::new(nodes.len(), pieces);
    let pinched = filtered(nodes.len(), |v| cost(v, &stars, pieces) > 0);
    report.found = pinched.len();
    let mut waiting: VecDeque<u32> = pinched.into();
    let mut looked = 0;
    while let Some(v) = waiting.pop_front() {
        looked += 1;
        if looked % CANCEL_CHECK_INTERVAL == 0 {
            watch.check_cancelled()?;
        }
        if let Some((tets, region)) = best_change(v, nodes, &stars, pieces) {
            report.relabelled_tets += tets.len();
            for t in &tets {
                pieces[*t as usize].1 = region;
            }
            waiting.extend(corners(&tets, pieces));
        }
    }
    let pinched = filtered(nodes.len(), |v| {
        !cost(v, &stars, pieces).is_multiple_of(OUTER_BOUNDARY_WEIGHT)
    });
    report.left = pinched.len();
    drop(stars);
    let mut suspects = vec![false; nodes.len()];
    for (tet, _) in pieces.iter().filter(|p| p.1 == 0) {
        tet.iter().for_each(|v| suspects[*v as usize] = true);
    }
    pieces.retain(|p| p.1 != 0);
    part(nodes, pieces, suspects, &mut report, watch)?;
    Ok(report)
}

/// Returns the numbers in 0..n that satisfy `is_so`, ascending.
fn filtered(n: usize, is_so: impl Fn(u32) -> bool + Sync) -> Vec<u32> {
    parallel::collect(n, |range, found| {
        found.extend(range.map(|v| v as u32).filter(|v| is_so(*v)));
    })
}

/// Returns the weighted number of pinches at `v`.
fn cost(v: u32, stars: &Stars, pieces: &[Piece]) -> usize {
    let star = stars.of(v);
    let region = |t: &u32| pieces[*t as usize].1;
    let Some(first) = star.first().map(region) else {
        return 0;
    };
    if star.iter().all(|t| region(t) == first) {
        return 0;
    }
    let [outer, inner] = VertexFans::new(v, star, pieces).count_excess_fans();
    OUTER_BOUNDARY_WEIGHT * outer + inner
}

/// Returns the nodes of some tets, ascending.
fn corners(tets: &[u32], pieces: &[Piece]) -> Vec<u32> {
    let mut corners: Vec<u32> = tets.iter().flat_map(|t| pieces[*t as usize].0).collect();
    corners.sort_unstable();
    corners.dedup();
    corners
}

/// Returns the tets at `v`, and the region to assign them to, that minimise the number of pinches;
/// `None` if no change reduces it.
fn best_change(
    v: u32,
    nodes: &[DVec3],
    stars: &Stars,
    pieces: &mut [Piece],
) -> Option<(Vec<u32>, u16)> {
    if cost(v, stars, pieces) == 0 {
        return None;
    }
    let star = stars.of(v);
    let mut fans = VertexFans::new(v, star, pieces);
    let mut changes: Vec<(Vec<u32>, u16)> = Vec::new();
    for region in fans.regions() {
        for of in [true, false] {
            let (fan, count) = fans.split(|r| (r == region) == of);
            if count < 2 {
                continue;
            }
            let mut each: Vec<u32> = fan.iter().copied().filter(|f| *f != u32::MAX).collect();
            each.sort_unstable();
            each.dedup();
            for one in each {
                let within: Vec<bool> = fan.iter().map(|f| *f == one).collect();
                let tets = star.iter().zip(&within).filter(|t| *t.1);
                let tets: Vec<u32> = tets.map(|t| *t.0).collect();
                let to = match of {
                    true => fans.dominant_neighbour(&within),
                    false => Some(region),
                };
                changes.extend(to.filter(|_| !tets.is_empty()).map(|to| (tets, to)));
            }
        }
    }
    let volume = |tets: &[u32]| -> f64 {
        let corners = |t: &u32| pieces[*t as usize].0.map(|v| nodes[v as usize]);
        tets.iter().map(|t| signed_volume(corners(t))).sum()
    };
    let mut sized: Vec<(f64, (Vec<u32>, u16))> =
        changes.into_iter().map(|c| (volume(&c.0), c)).collect();
    sized.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best: Option<(usize, (Vec<u32>, u16))> = None;
    for (_, (tets, region)) in sized {
        let around = corners(&tets, pieces);
        let total = |pieces: &[Piece]| around.iter().map(|u| cost(*u, stars, pieces)).sum();
        let before: usize = total(pieces);
        let old: Vec<u16> = tets.iter().map(|t| pieces[*t as usize].1).collect();
        for t in &tets {
            pieces[*t as usize].1 = region;
        }
        let after: usize = total(pieces);
        for (t, region) in tets.iter().zip(old) {
            pieces[*t as usize].1 = region;
        }
        let gain = before.saturating_sub(after);
        if gain > best.as_ref().map_or(0, |b| b.0) {
            best = Some((gain, (tets, region)));
        }
    }
    best.map(|b| b.1)
}

/// Splits the body where its boundary is still non-manifold, at the nodes `suspects`. All pieces
/// must be inside.
fn part(
    nodes: &mut Vec<DVec3>,
    pieces: &mut Vec<Piece>,
    mut suspects: Vec<bool>,
    report: &mut NonManifoldReport,
    watch: &ProgressScope,
) -> Result<()> {
    loop {
        watch.check_cancelled()?;
        let stars = Stars::new(nodes.len(), pieces);
        let pinched = filtered(nodes.len(), |v| {
            if !suspects.get(v as usize).copied().unwrap_or(true) {
                return false;
            }
            let mut fans = VertexFans::new(v, stars.of(v), pieces);
            !fans.is_boundary_manifold() || fans.split(|r| r != 0).1 > 1
        });
        if pinched.is_empty() {
            return Ok(());
        }
        let mut gone = vec![false; pieces.len()];
        let mut changes: Vec<(u32, u32, u32)> = Vec::new();
        for v in pinched {
            let star = stars.of(v);
            let (fan, count) = VertexFans::new(v, star, pieces).split(|r| r != 0);
            if count < 2 {
                for t in star {
                    gone[*t as usize] = true;
                    let corners = pieces[*t as usize].0;
                    corners.iter().for_each(|v| suspects[*v as usize] = true);
                }
                report.relabelled_tets += star.len();
                continue;
            }
            let mut each: Vec<u32> = fan.iter().copied().filter(|f| *f != u32::MAX).collect();
            each.sort_unstable();
            each.dedup();
            // The first fan keeps the node.
            for one in each.into_iter().skip(1) {
                let double = nodes.len() as u32;
                nodes.push(nodes[v as usize]);
                suspects.push(true);
                report.duplicated_nodes += 1;
                let tets = star.iter().zip(&fan).filter(|t| *t.1 == one);
                changes.extend(tets.map(|(t, _)| (*t, v, double)));
            }
        }
        for (t, v, double) in changes {
            for corner in &mut pieces[t as usize].0 {
                if *corner == v {
                    *corner = double;
                }
            }
        }
        let mut gone = gone.into_iter();
        pieces.retain(|_| !gone.next().unwrap_or(false));
    }
}
