//! The further press that would tell most: the expected gain of information over places of the body.

use super::chain::DerivedBy;
use super::data::{Observed, Place};
use super::forward::{BodyExperiment, MeasuredBody};
use super::least_squares::Solution;
use super::report::PressAdvice;
use super::uncertainty::Uncertainty;
use crate::press::Presser;
use crate::{ProgressFn, Result};
use nalgebra::DVector;

/// Number of places that are compared.
const PLACES: usize = 12;
/// Smallest gain that is worth a press, bits.
const MIN_GAIN: f64 = 0.1;

/// Returns the place, among some that are spread over the free surface, where a press as deep as the
/// deepest one and with its noise would tell most (Lindley 1956, "On a measure of the information provided
/// by an experiment"); `None` if none would tell anything.
///
/// # Errors
/// As a press; a place that cannot be pressed is left out.
pub(super) fn best_press(
    body: &MeasuredBody,
    (best, uncertainty): (&Solution, &Uncertainty),
    progress: ProgressFn,
) -> Result<Option<PressAdvice>> {
    let presses = body.experiments.iter().find_map(BodyExperiment::presses);
    let Some(experiment) = presses else {
        return Ok(None);
    };
    let (scene, mesh) = body.with_values(&best.values);
    let presser = Presser::new(body.gpu, &scene, &mesh, experiment.radius)?;
    let observed = experiment.places.iter().flat_map(|place| &place.observed);
    let depth = observed.map(|own| own.depth).fold(0.0, f64::max);
    let places: Vec<Place> = presser
        .spread_sites(PLACES)
        .into_iter()
        .map(|site| Place {
            at: site.point,
            outward: site.outward,
            depths: (1..=4).map(|k| 0.25 * depth * f64::from(k)).collect(),
            observed: vec![Observed {
                quantity: String::new(),
                at: site.point,
                weights: vec![(3, 1.0)],
                depth,
                value: 0.0,
                scale: 1.0,
            }],
        })
        .collect();
    let asked: Vec<(f64, &Place)> = places
        .iter()
        .map(|place| (experiment.radius, place))
        .collect();
    let forces = body.press_all((&best.values, DerivedBy::Unknowns), &asked, progress)?;
    // Relative to its own force.
    let ratios = body.observations().iter().zip(body.standard_deviations());
    let noise = ratios
        .map(|(observed, sigma)| sigma / observed.scale)
        .fold(0.0, f64::max);
    let noise = noise * uncertainty.noise_factor.max(1e-3);
    let widest = widest_unknown(body, uncertainty);
    let mut found: Option<PressAdvice> = None;
    for (place, forces) in places.iter().zip(forces) {
        let Ok(forces) = forces else {
            continue;
        };
        let Some(force) = forces.last().filter(|force| force.value > 0.0) else {
            continue;
        };
        let row = body.unknowns().iter().enumerate().map(|(k, unknown)| {
            force.derivatives[k] * unknown.slope(best.values[k]) / (noise * force.value)
        });
        let row = DVector::from_iterator(best.theta.len(), row);
        let along = &uncertainty.covariance * &row;
        let gain = 1.0 + row.dot(&along);
        let bits = 0.5 * gain.log2();
        let before = uncertainty.covariance[(widest, widest)];
        let after = before - along[widest].powi(2) / gain;
        if bits > found.as_ref().map_or(MIN_GAIN, |advice| advice.bits) {
            found = Some(PressAdvice {
                at: place.at.to_array(),
                direction: (-place.outward).to_array(),
                depth_m: depth,
                bits,
                unknown: body.unknowns()[widest].name.clone(),
                narrower: (after / before).max(0.0).sqrt(),
            });
        }
    }
    Ok(found)
}

/// Returns the unknown with the widest interval on its own scale.
fn widest_unknown(body: &MeasuredBody, uncertainty: &Uncertainty) -> usize {
    let spread = |k: &usize| uncertainty.covariance[(*k, *k)];
    (0..body.unknowns().len())
        .max_by(|a, b| spread(a).total_cmp(&spread(b)))
        .unwrap_or(0)
}
