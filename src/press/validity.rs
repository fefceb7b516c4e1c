//! Checks whether a press measured the elastic response of a body to its fingertip.

use super::curve::PressSample;
use super::site::{Boundary, PressSite};
use crate::Result;
use crate::mesh::{DisjointSets, TetMesh};
use crate::number_format::significant;
use crate::scene::Motion;
use std::fmt;

/// Forces below this fraction of the largest count as zero.
const ZERO_FORCE_RATIO: f64 = 1e-3;
/// Depth from which the fingertip must touch the body, relative to the largest.
const CONTACT_DEPTH_RATIO: f64 = 0.25;
/// Largest decrease of the force while loading, and largest difference between loading and
/// unloading, relative to the largest force.
const TOLERANCE: f64 = 0.05;
/// Change of the force in one step of a press by hand that counts as a jump, relative to the
/// largest force; and the number of steps before which none does.
const JUMP_RATIO: f64 = 0.5;
const MIN_SAMPLES: usize = 8;

/// Returns why the force–depth curve is not that of a fingertip on an elastic body, one sentence
/// each with what to do; empty if it is.
pub(crate) fn curve_warnings(samples: &[PressSample]) -> Vec<String> {
    let way = |phase: &'static str| -> Vec<[f64; 2]> {
        let own = samples.iter().filter(move |s| s.phase == phase);
        own.map(|s| [s.depth_m, s.force_n]).collect()
    };
    let (load, unload) = (way("load"), way("unload"));
    let most = samples.iter().map(|s| s.force_n.abs()).fold(0.0, f64::max);
    let deepest = load.iter().map(|s| s[0]).fold(0.0, f64::max);
    let warnings = [
        lost_contact(&load, deepest, most),
        attraction(samples, most),
        decrease(&load, most),
        hysteresis(&load, &unload, most),
    ];
    warnings.into_iter().flatten().collect()
}

/// Formats a depth, m, in mm.
fn millimetres(depth: f64) -> String {
    format!("{} mm", significant(1e3 * depth))
}

fn lost_contact(load: &[[f64; 2]], deepest: f64, most: f64) -> Option<String> {
    let inside = load
        .iter()
        .filter(|s| s[0] > CONTACT_DEPTH_RATIO * deepest && s[0] > 0.0);
    let mut lost = inside.filter(|s| s[1].abs() <= ZERO_FORCE_RATIO * most);
    lost.next().map(|[depth, _]| {
        format!(
            "the fingertip is {} deep without touching the body; it slipped past it, or the body gives way freely: use a larger --radius, a finer mesh, another site (--at) or a pin ([[pin]])",
            millimetres(*depth)
        )
    })
}

fn attraction(samples: &[PressSample], most: f64) -> Option<String> {
    let lowest = samples
        .iter()
        .min_by(|a, b| a.force_n.total_cmp(&b.force_n))?;
    (lowest.force_n < -ZERO_FORCE_RATIO * most).then(|| {
        format!(
            "the body pulls on the fingertip with {} N at a depth of {}: it closed around it; press less deep (--depth), or with a larger --radius",
            significant(-lowest.force_n),
            millimetres(lowest.depth_m)
        )
    })
}

fn decrease(load: &[[f64; 2]], most: f64) -> Option<String> {
    let mut peak = [0.0, f64::NEG_INFINITY];
    let mut worst: Option<([f64; 2], [f64; 2])> = None;
    for sample in load {
        if sample[1] > peak[1] {
            peak = *sample;
        }
        let drop = peak[1] - sample[1];
        if drop > TOLERANCE * most && worst.is_none_or(|(p, s)| drop > p[1] - s[1]) {
            worst = Some((peak, *sample));
        }
    }
    worst.map(|([before, high], [after, low])| {
        format!(
            "the force falls from {} N at {} to {} N at {} although the fingertip advances: the body buckled, slipped aside or snapped to another shape; press less deep (--depth), at another site (--at), or on a finer mesh",
            significant(high),
            millimetres(before),
            significant(low),
            millimetres(after)
        )
    })
}

fn hysteresis(load: &[[f64; 2]], unload: &[[f64; 2]], most: f64) -> Option<String> {
    let off = |s: &[f64; 2]| interpolate(load, s[0]).map(|force| (s[0], s[1] - force));
    let worst = unload.iter().filter_map(off);
    let (depth, difference) = worst.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    (difference.abs() > TOLERANCE * most).then(|| {
        format!(
            "loading and unloading differ by {} % of the largest force at a depth of {}, although the body is elastic and without friction: it snapped to another shape; press less deep (--depth), with a larger --radius, or on a finer mesh",
            significant(100.0 * difference.abs() / most),
            millimetres(depth)
        )
    })
}

/// Interpolates the force linearly at `depth`; `None` outside of the curve.
fn interpolate(load: &[[f64; 2]], depth: f64) -> Option<f64> {
    let after = load.iter().position(|s| s[0] >= depth)?;
    let [x, y] = load[after];
    let Some([x0, y0]) = after.checked_sub(1).map(|k| load[k]) else {
        return (x == depth).then_some(y);
    };
    Some(y0 + (y - y0) * (depth - x0) / (x - x0).max(f64::MIN_POSITIVE))
}

/// A state of a press by hand in which its force has no meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ContactProblem {
    /// The body pulls on the fingertip.
    Attraction,
    /// The fingertip is inside without touching the body.
    LostContact,
    /// The force has jumped since the step before.
    Jump,
    /// The fingertip is smaller than the faces beneath it.
    CoarseFaces,
    /// The body is in pieces that pass through each other.
    Pieces,
    /// The body is held where it is pressed.
    Held,
}

impl fmt::Display for ContactProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ContactProblem::Attraction => {
                "force not valid: the body closed around the finger and pulls on it; press less deep, or with a larger finger"
            }
            ContactProblem::LostContact => {
                "force not valid: the finger is inside without touching the body; withdraw it, and use a larger finger or a finer mesh"
            }
            ContactProblem::Jump => {
                "force not valid: the body snapped to another shape; withdraw the finger and press less deep"
            }
            ContactProblem::CoarseFaces => {
                "force not valid: the finger is smaller than the faces beneath it; use a larger finger or a finer mesh"
            }
            ContactProblem::Held => {
                "force not valid: the body is held here (by a [[pin]], or on the table), so that the finger meets no resistance; press at another place"
            }
            ContactProblem::Pieces => {
                "force not valid: the body is in pieces that pass through each other; open one of them, join them in the mesh, or add [contact] to the scene"
            }
        })
    }
}

/// Returns the problem of the last of the `samples` (depth and force) of a press by hand, if any.
pub(crate) fn contact_problem(samples: &[[f64; 2]]) -> Option<ContactProblem> {
    let (&[depth, force], before) = samples.split_last()?;
    let most = samples.iter().map(|s| s[1].abs()).fold(0.0, f64::max);
    let deepest = samples.iter().map(|s| s[0]).fold(0.0, f64::max);
    if most == 0.0 && depth <= 0.0 {
        return None;
    }
    if force < -ZERO_FORCE_RATIO * most {
        return Some(ContactProblem::Attraction);
    }
    let touched = before.iter().any(|s| s[0] >= depth && s[1] > 0.0);
    let advancing = before.last().is_none_or(|last| depth >= last[0]);
    let inside = depth > CONTACT_DEPTH_RATIO * deepest && depth > 0.0;
    if inside && advancing && !touched && force <= ZERO_FORCE_RATIO * most {
        return Some(ContactProblem::LostContact);
    }
    let last = before.last()?;
    let jump = (force - last[1]).abs();
    (before.len() >= MIN_SAMPLES && inside && jump > JUMP_RATIO * most)
        .then_some(ContactProblem::Jump)
}

/// Returns why a press at `site` with a fingertip of `radius` cannot be measured, one sentence each, with
/// that about the `pieces` of the body.
pub(super) fn body_warnings(
    boundary: &Boundary,
    site: &PressSite,
    radius: f64,
    (is_held, pieces): (bool, Option<String>),
) -> Vec<String> {
    let held = is_held.then(|| {
        "the body is held where it is pressed (by a [[pin]], or on the table), so that the fingertip meets no resistance; press at another site (--at)".to_owned()
    });
    let edge = boundary.edge_near(site.point, radius);
    let small = (radius < edge).then(|| {
        format!(
            "the fingertip of radius {} is smaller than the faces beneath it, whose edges measure {}; use a --radius above {}, or a finer mesh (--tets)",
            significant(radius),
            significant(edge),
            significant(edge)
        )
    });
    held.into_iter().chain(pieces).chain(small).collect()
}

/// Returns whether all nodes of the boundary that the fingertip of `radius` can touch at `site`, in file
/// units, are held: contact has no effect on them.
pub(super) fn is_held(motion: &Motion, site: &PressSite, radius: f64) -> Result<bool> {
    let (mesh, topology) = (motion.simulator.mesh(), motion.simulator.topology());
    let (x, held) = (motion.positions()?, motion.simulator.loads().pinned());
    let faces = topology.boundary.iter();
    let nodes = faces.flat_map(|b| topology.boundary_nodes(mesh, *b));
    let mut near = nodes
        .filter(|v| x[*v as usize].distance(site.point) <= radius)
        .peekable();
    Ok(near.peek().is_some() && near.all(|v| held[v as usize]))
}

/// Returns a warning if the tets of `mesh` form several pieces without common nodes.
pub(super) fn in_pieces(mesh: &TetMesh) -> Option<String> {
    let mut groups = DisjointSets::new(mesh.nodes.len());
    for [a, b, c, d] in &mesh.tets {
        [b, c, d].into_iter().for_each(|v| groups.union(*a, *v));
    }
    let mut roots: Vec<u32> = mesh.tets.iter().map(|t| groups.find(t[0])).collect();
    roots.sort_unstable();
    roots.dedup();
    (roots.len() > 1).then(|| {
        format!(
            "the body is in {} pieces that pass through each other; press one of them, join them in the mesh, or add [contact] to the scene",
            roots.len()
        )
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn curve(load: &[f64], unload: &[f64]) -> Vec<PressSample> {
        let sample = |phase, depth: usize, force_n: &f64| PressSample {
            time_s: 0.0,
            phase,
            depth_m: 1e-3 * depth as f64,
            force_n: *force_n,
        };
        let way_in = load.iter().enumerate().map(|(k, f)| sample("load", k, f));
        let back = unload
            .iter()
            .enumerate()
            .map(|(k, f)| sample("unload", load.len() - 2 - k, f));
        way_in.chain(back).collect()
    }

    #[test]
    fn problems_of_presses_by_hand_are_found() {
        let curve: Vec<[f64; 2]> = (0..20).map(|k| [f64::from(k), f64::from(k * k)]).collect();
        for end in 0..=curve.len() {
            assert_eq!(contact_problem(&curve[..end]), None, "{end}");
        }
        let then = |last: [f64; 2]| {
            let mut all = curve.clone();
            all.push(last);
            contact_problem(&all)
        };
        assert_eq!(then([20.0, -84.0]), Some(ContactProblem::Attraction));
        assert_eq!(then([20.0, 0.0]), Some(ContactProblem::LostContact));
        assert_eq!(then([20.0, 800.0]), Some(ContactProblem::Jump));
        assert_eq!(then([-1.0, 0.0]), None);
        assert_eq!(
            contact_problem(&[[0.0, 0.0], [1.0, 0.0]]),
            Some(ContactProblem::LostContact)
        );
    }

    #[test]
    fn each_kind_of_invalid_curve_is_reported() {
        let valid = curve(&[0.0, 1.0, 2.0, 3.1, 4.0], &[3.0, 2.1, 1.0, 0.0]);
        assert_eq!(curve_warnings(&valid), Vec::<String>::new());
        assert_eq!(curve_warnings(&[]), Vec::<String>::new());
        for (load, unload, word) in [
            (
                [0.0, 1.0, 2.0, 3.0, 0.0],
                [0.0, 0.0, 0.0, 0.0],
                "without touching",
            ),
            (
                [0.0, 1.0, 2.0, 3.0, -1.0],
                [-2.0, 2.0, 1.0, 0.0],
                "pulls on",
            ),
            (
                [0.0, 1.0, 3.0, 2.5, 4.0],
                [2.5, 3.0, 1.0, 0.0],
                "falls from 3 N at 2 mm to 2.5 N at 3 mm",
            ),
            (
                [0.0, 1.0, 2.0, 3.0, 4.0],
                [2.0, 2.0, 1.0, 0.0],
                "25 % of the largest force at a depth of 3 mm",
            ),
        ] {
            let found = curve_warnings(&curve(&load, &unload)).join("; ");
            assert!(found.contains(word), "{word}: {found}");
        }
    }
}
