//! Local improvement of the worst tets: node smoothing, edge flips and edge collapses.
//!
//! Other tets are unchanged, and a step is taken only if it improves the worst tet that it changes.
//! After Freitag & Ollivier-Gooch, *Tetrahedral mesh improvement using swapping and smoothing*
//! (1997), and Klingner & Shewchuk, *Aggressive tetrahedral mesh improvement* (2007).

mod collapse;
mod editable_mesh;
mod flip;
mod quality;
mod smooth;

use super::domain::OffsetDomain;
use super::stencil::Piece;
use crate::Result;
use crate::parallel;
use crate::progress::ProgressScope;
use editable_mesh::EditableMesh;
use glam::DVec3;

/// Tets below this quality are improved: 11.5° for acute angles.
const TARGET_QUALITY: f64 = 0.2;

/// Maximum number of passes over the bad tets.
const MAX_PASSES: usize = 6;

/// Number of tets between two checks for cancellation.
const CANCEL_CHECK_INTERVAL: usize = 256;

/// Statistics of the improvement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct OptimiserReport {
    /// Tets below the target quality at the start.
    #[serde(rename = "bad")]
    pub below_target: usize,
    /// Node moves.
    pub moved: usize,
    /// Edge and face flips.
    pub flipped: usize,
    /// Edge collapses.
    pub collapsed: usize,
    /// Tets still below the target quality.
    #[serde(rename = "left")]
    pub remaining: usize,
}

/// Improves the worst tets. Nodes from number `doubled` on, and those at the same positions, are
/// fixed.
pub(super) fn optimise(
    domain: OffsetDomain,
    edge: f64,
    doubled: usize,
    (nodes, pieces): (&mut Vec<DVec3>, &mut Vec<Piece>),
    part: &ProgressScope,
) -> Result<OptimiserReport> {
    let mut report = OptimiserReport::default();
    let mut bad = bad_tets(nodes, pieces);
    report.below_target = bad.len();
    if bad.is_empty() {
        return Ok(report);
    }
    let (own_nodes, own_pieces) = (std::mem::take(nodes), std::mem::take(pieces));
    let mut work = EditableMesh::new(domain, edge, doubled, own_nodes, own_pieces);
    for _ in 0..MAX_PASSES {
        let before = report;
        for some in bad.chunks(CANCEL_CHECK_INTERVAL) {
            part.check_cancelled()?;
            for t in some {
                work.improve_tet(*t, &mut report);
            }
        }
        bad = bad_tets(&work.nodes, &work.pieces);
        if bad.is_empty() || report == before {
            break;
        }
    }
    report.remaining = bad.len();
    (*nodes, *pieces) = (work.nodes, work.pieces);
    pieces.retain(|p| p.1 != 0);
    Ok(report)
}

/// Returns the tets below the target quality, the worst first.
fn bad_tets(nodes: &[DVec3], pieces: &[Piece]) -> Vec<u32> {
    let shape = |t: usize| quality::quality(pieces[t].0.map(|v| nodes[v as usize]));
    let mut bad: Vec<(f64, u32)> = parallel::collect(pieces.len(), |range, bad| {
        let inside = range.filter(|t| pieces[*t].1 != 0);
        let shapes = inside.map(|t| (shape(t), t as u32));
        bad.extend(shapes.filter(|(shape, _)| *shape < TARGET_QUALITY));
    });
    bad.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    bad.into_iter().map(|b| b.1).collect()
}

impl EditableMesh<'_> {
    /// Applies operations to tet `t` until it is good enough or none improves it.
    fn improve_tet(&mut self, t: u32, report: &mut OptimiserReport) {
        for _ in 0..4 {
            if !self.is_bad(t) {
                return;
            }
            if self.flip_around(t) {
                report.flipped += 1;
                continue;
            }
            let mut moved = false;
            for v in self.pieces[t as usize].0 {
                while self.smooth(v) {
                    report.moved += 1;
                    moved = true;
                    if !self.is_bad(t) {
                        return;
                    }
                }
            }
            if self.collapse_around(t) {
                report.collapsed += 1;
                continue;
            }
            if !moved {
                return;
            }
        }
    }

    fn is_bad(&self, t: u32) -> bool {
        self.pieces[t as usize].1 != 0 && self.tet_quality(t) < TARGET_QUALITY
    }
}
