//! Search for the edge length that gives a target number of tets.

use crate::{Error, Result};

/// Relative tolerance of the number of tets of a trial: the clean-up removes or adds a few
/// afterwards.
const COUNT_TOLERANCE: f64 = 0.1;

/// Maximum number of trials; the best one is used.
const MAX_TRIALS: usize = 12;

/// Maximum number of trials without tets inside; each halves the edge.
const MAX_EMPTY_TRIALS: usize = 6;

/// Maximum ratio of all tets, including those outside along the boundary, to the target while those
/// inside are fewer than the target. Then the edge is more than three times the thickness of the
/// body.
pub(crate) const MAX_OUTSIDE_RATIO: usize = 20;

/// Minimum fraction of the target of a result that the search was stopped at.
const MIN_FRACTION: f64 = 0.5;

/// The fractions of the target number of tets used for the first and the second trial.
const FIRST_TRIALS: [f64; 2] = [0.06, 0.22];

/// Decrease of the exponent per factor of e in the edge for a graded mesh: measured on bones, a
/// lung, a knee.
const EXPONENT_DROP: f64 = 0.55;

/// Searches for the edge at which `lay` generates about `wanted` tets of a body of about that
/// volume, and returns the result. `count` returns the number of tets inside, and of all including
/// those outside along the boundary.
///
/// The number of tets is a power of the edge with an exponent between 3, for the interior, and 2,
/// for the boundary; it is estimated from the trials, of which the first two are small. If the mesh
/// is `graded`, the exponent decreases with the edge.
pub(crate) fn find_spacing<T>(
    wanted: usize,
    volume: f64,
    graded: bool,
    mut lay: impl FnMut(f64) -> Result<T>,
    count: impl Fn(&T) -> [usize; 2],
) -> Result<T> {
    if wanted < 100 || wanted > u32::MAX as usize / 8 {
        return Err(Error::Input(format!(
            "number of tets must be 100 to {}, got {wanted}",
            u32::MAX / 8
        )));
    }
    let target = wanted as f64;
    // A box full of tets has twelve per cube of the edge.
    let mut edge = (12.0 * volume / (FIRST_TRIALS[0] * target)).cbrt();
    let mut before: Option<(f64, f64)> = None;
    let mut best: Option<(f64, T)> = None;
    let mut empty_trials = 0;
    let mut is_too_thin = false;
    for _ in 0..MAX_TRIALS {
        let trial = match lay(edge) {
            // An edge that nobody entered is no error of theirs.
            Err(Error::Input(_)) if before.is_some() => break,
            trial => trial?,
        };
        let [inside, all] = count(&trial);
        let made = inside as f64;
        if inside == 0 {
            empty_trials += 1;
        }
        // The boundary alone has more tets: the body is thinner than the edges of this number.
        is_too_thin = match inside {
            0 => all > wanted || empty_trials >= MAX_EMPTY_TRIALS,
            _ => inside < wanted && all / MAX_OUTSIDE_RATIO > wanted,
        };
        let off = (made / target).ln().abs();
        if best.as_ref().is_none_or(|b| off < b.0) {
            best = Some((off, trial));
        }
        if is_too_thin || off < COUNT_TOLERANCE {
            before = Some((edge, made));
            break;
        }
        let (goal, power) = match before {
            Some((edge_before, made_before)) if made > 0.0 && made_before > 0.0 => {
                let power = (made / made_before).ln() / (edge_before / edge).ln();
                let power = power.clamp(1.5, 3.5);
                let step = (target / made).ln() / power;
                let ahead = 0.5 * ((edge_before / edge).ln() + step);
                let bend = if graded { EXPONENT_DROP * ahead } else { 0.0 };
                (target, (power - bend).clamp(1.5, 3.5))
            }
            None if made < FIRST_TRIALS[1] * target => (FIRST_TRIALS[1] * target, 2.5),
            _ => (target, 2.5),
        };
        before = Some((edge, made));
        edge *= match made > 0.0 {
            true => (made / goal).powf(1.0 / power).clamp(0.2, 5.0),
            false => 0.5,
        };
    }
    let least = match is_too_thin {
        true => MIN_FRACTION * target,
        false => 1.0,
    };
    match best {
        Some((_, trial)) if count(&trial)[0] as f64 >= least => Ok(trial),
        _ => {
            let tried = before.map_or(edge, |b| b.0);
            Err(Error::Input(format!(
                "body is too thin for about {wanted} tets: little or nothing of it is left at an edge \
                length of {tried:.3e}; increase the number of tets, set a smaller edge length, or \
                check that the input encloses a volume"
            )))
        }
    }
}
