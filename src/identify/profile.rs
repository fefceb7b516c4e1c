//! Intervals by profile likelihood: an unknown is held beside its optimum while the others are adjusted, until
//! the sum of squares has grown by as much as an interval allows (Venzon, Moolgavkar 1988, "A method for
//! computing profile-likelihood-based confidence intervals"). Exact for any transformation of the unknown,
//! where Laplace's approximation takes the sum of squares for a parabola.

use super::least_squares::{self, Model, Solution, Start};
use super::uncertainty::Uncertainty;
use crate::{Error, Result};

/// Largest number of values that are tried on a side.
const MAX_TRIALS: u32 = 8;
/// Error of an end relative to its distance from the optimum.
const CLOSE: f64 = 0.03;
/// Largest factor from one trial to the next.
const LARGEST_FACTOR: f64 = 3.0;

/// Distance of θ from its optimum, and √ΔS there over that of the end.
#[derive(Clone, Copy)]
struct Trial {
    distance: f64,
    growth: f64,
}

/// Returns how far θ of unknown `k` can be below and above its optimum; up to its bounds at most.
///
/// # Errors
/// [`Error::Input`] if the sum of squares becomes smaller beside the optimum; those of predictions at values
/// next to the optimum.
pub(super) fn reach(
    model: &Model,
    (best, k): (&Solution, usize),
    uncertainty: &Uncertainty,
) -> Result<[f64; 2]> {
    let model = Model {
        held: Some(k),
        ..*model
    };
    let unknown = &model.body.unknowns()[k];
    let [low, high] = unknown.bounds.map(|value| unknown.theta(value));
    let side = |sign: f64, most: f64| side((&model, best, k), (sign, most), uncertainty);
    Ok([
        side(-1.0, best.theta[k] - low)?,
        side(1.0, high - best.theta[k])?,
    ])
}

fn side(
    (model, best, k): (&Model, &Solution, usize),
    (sign, most): (f64, f64),
    uncertainty: &Uncertainty,
) -> Result<f64> {
    let allowed = uncertainty.quantile * uncertainty.noise_factor;
    // The others follow the unknown along the axis of the ellipsoid.
    let covariance = uncertainty.covariance.column(k) / uncertainty.covariance[(k, k)];
    let laplace = if sign < 0.0 {
        uncertainty.reach[k][0]
    } else {
        uncertainty.reach[k][1]
    };
    let mut below = Trial {
        distance: 0.0,
        growth: 0.0,
    };
    let mut above: Option<Trial> = None;
    let mut distance = laplace.min(most);
    for _ in 0..MAX_TRIALS {
        let start = Start {
            theta: &best.theta + sign * distance * &covariance,
        };
        let growth = match least_squares::minimise(model, &start, &mut |_, _, _| Ok(())) {
            Ok(held) => {
                let more = held.sum_of_squares() - best.sum_of_squares();
                // More than the search for the optimum leaves.
                if more < -1e-3 * allowed * allowed {
                    return Err(Error::Input(format!(
                        "other values with {} = {} explain the data better than those found; start there (--first {0}={1}), or from several values (--starts)",
                        model.body.unknowns()[k].name,
                        crate::number_format::rounded(held.values[k], 4)
                    )));
                }
                more.max(0.0).sqrt() / allowed
            }
            // No equilibrium there: nearer to the optimum.
            Err(Error::Solver { .. } | Error::Input(_)) if distance > 1e-3 * laplace => {
                LARGEST_FACTOR
            }
            Err(other) => return Err(other),
        };
        let trial = Trial { distance, growth };
        if (growth - 1.0).abs() < CLOSE || (growth < 1.0 && distance >= most) {
            break;
        }
        if growth < 1.0 {
            below = trial;
        } else {
            above = Some(trial);
        }
        // √ΔS is about proportional to the distance.
        distance = match above {
            Some(above) => {
                let share = (1.0 - below.growth) / (above.growth - below.growth);
                below.distance + share.clamp(0.1, 0.9) * (above.distance - below.distance)
            }
            None => distance * (1.0 / growth.max(1e-6)).min(LARGEST_FACTOR),
        }
        .min(most);
    }
    Ok(distance)
}
