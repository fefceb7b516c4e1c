//! The result of an identification in sentences.

use super::correction::ForceCorrection;
use super::report::{Identified, IdentifiedValue, Residual, StiffnessFactor};
use super::uncertainty::{PROBABILITY, Uncertainty};
use super::unknown::ScaledUnknown;
use crate::mesh::ElementOrder;
use crate::number_format::{rounded, significant};

/// Weights below this part of the largest are left out of a combination.
const SMALL_WEIGHT: f64 = 0.1;
/// Intervals of a factor that are wider than this hardly tell it.
const WIDE: f64 = 4.0;
/// Part of an interval by which the last correction of forces may change a value.
const UNSETTLED: f64 = 0.2;
/// Reaches of θ beyond which the sum of squares may be no parabola: a factor of 1.65, or half a large change.
const SKEWED: f64 = 0.5;

/// Returns the results in sentences.
pub(super) fn sentences(
    found: &Identified,
    scaled: &[ScaledUnknown],
    uncertainty: &Uncertainty,
) -> Vec<String> {
    let mut all: Vec<String> = found.unknowns.iter().map(value_sentence).collect();
    let wide = scaled.iter().enumerate().filter(|(k, unknown)| {
        let is_shown = found.unknowns.iter().any(|own| own.name == unknown.name);
        is_shown && !uncertainty.is_profiled[*k] && uncertainty.reach[*k][0] > SKEWED
    });
    let wide: Vec<&str> = wide.map(|(_, unknown)| unknown.name.as_str()).collect();
    if !wide.is_empty() {
        all.push(format!(
            "wide intervals may be skewed; profile likelihood finds their ends (--profile {})",
            wide.join(",")
        ));
    }
    all.extend(stiffness_sentences(&found.stiffness));
    for weights in &uncertainty.undetermined {
        all.push(format!(
            "the data do not determine {}; more places, depths or another tool might",
            combination(scaled, weights)
        ));
    }
    if found.is_misfit {
        all.push(misfit_sentence(found, uncertainty.noise_factor));
    }
    if !found.converged {
        all.push(
            "the search ended after its largest number of steps; the values may still change"
                .into(),
        );
    }
    all.extend(error_sentences(
        &found.discretisation_errors,
        ", which the intervals include",
    ));
    all.extend(
        found
            .correction
            .iter()
            .map(|own| correction_sentence(own, &found.unknowns)),
    );
    for other in &found.other_optima {
        let values: Vec<String> = other.iter().map(|x| significant(*x)).collect();
        all.push(format!(
            "another start led to values that explain the data nearly as well: {}",
            values.join(", ")
        ));
    }
    all.extend(found.next_press.as_ref().map(|advice| {
        format!(
            "a further press at {} would tell most: {:.1} bits; the interval of {} would be {:.0} % as wide",
            advice.at.map(|x| rounded(x, 4)).join(","),
            advice.bits,
            advice.unknown,
            100.0 * advice.narrower
        )
    }));
    all
}

/// Returns a value and its interval.
fn value_sentence(value: &IdentifiedValue) -> String {
    let unit = match value.unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    format!(
        "{} = {}{unit}, {} % interval {} to {}{unit}{}",
        value.name,
        rounded(value.value, 4),
        100.0 * PROBABILITY,
        rounded(value.low, 3),
        rounded(value.high, 3),
        match value.at_bound {
            true => "; it is at its bound, so the data ask for a value beyond it (--bounds)",
            false => "",
        }
    )
}

/// Returns that the residuals are larger than the noise, and what may explain them.
fn misfit_sentence(found: &Identified, noise_factor: f64) -> String {
    let is_press = |row: &Residual| ["force", "stiffness"].contains(&row.quantity.as_str());
    let may_be_corrected = found.correction.is_none()
        && found.mesh.order == ElementOrder::Linear
        && found.residuals.iter().any(is_press);
    format!(
        "the scene does not explain the data: the residuals are {} times the stated noise; intervals are widened for it. {}Another start (--starts), law or shape, or other supports may explain them",
        significant(noise_factor),
        match may_be_corrected {
            true => "Linear tets may be a part of it (--correct 2). ",
            false => "",
        }
    )
}

/// Returns how quadratic tets corrected the forces, and whether that has settled.
fn correction_sentence(correction: &ForceCorrection, unknowns: &[IdentifiedValue]) -> String {
    let [low, high] = correction.ratios.map(|ratio| 100.0 * (ratio - 1.0));
    let by = format!("quadratic tets changed the forces by {low:+.1} to {high:+.1} %");
    let more = format!("--correct {}", correction.times + 1);
    let Some(changes) = &correction.last_changes else {
        if correction.times > 1 {
            return format!(
                "{by}; by how much the last of {} corrections changed the values is not known, because the search went on after it: one more shows it ({more})",
                correction.times
            );
        }
        return format!(
            "{by}; they were corrected once, at the first values: another correction at the values found shows how far those still change ({more})"
        );
    };
    let width = |k: usize| unknowns[k].high - unknowns[k].low;
    let share = |k: usize| changes[k].abs() / width(k).max(f64::MIN_POSITIVE);
    let most =
        (0..changes.len().min(unknowns.len())).max_by(|a, b| share(*a).total_cmp(&share(*b)));
    match most {
        Some(k) if share(k) > UNSETTLED => format!(
            "{by}; the last correction changed {} by {}, which the intervals include: give more ({more})",
            unknowns[k].name,
            significant(changes[k])
        ),
        _ => format!(
            "{by}; the last of {} corrections changed the values little",
            correction.times
        ),
    }
}

/// Returns sentences about a stiffness that varies: the extremes, and where the data tell nothing.
fn stiffness_sentences(factors: &[StiffnessFactor]) -> Vec<String> {
    let by = |a: &&StiffnessFactor, b: &&StiffnessFactor| a.factor.total_cmp(&b.factor);
    let (least, most) = (factors.iter().min_by(by), factors.iter().max_by(by));
    let extreme = |what: &str, one: &StiffnessFactor| {
        format!(
            "the {what} place is {} times as stiff as the scene has it, 90 % interval {} to {}, at {}",
            rounded(one.factor, 3),
            rounded(one.low, 2),
            rounded(one.high, 2),
            one.at.map(|x| rounded(x, 3)).join(",")
        )
    };
    let mut all: Vec<String> = Vec::new();
    all.extend(most.map(|one| extreme("stiffest", one)));
    all.extend(least.map(|one| extreme("softest", one)));
    let wide = |one: &&StiffnessFactor| one.high / one.low > WIDE;
    let unsure = factors.iter().filter(wide).count();
    if unsure > 0 {
        all.push(format!(
            "at {unsure} of {} places of the grid the interval is wider than a factor of {WIDE}: the data hardly tell the stiffness there",
            factors.len()
        ));
    }
    all
}

/// Returns the discretisation errors in sentences.
pub(super) fn error_sentences<'a>(
    errors: &'a [Option<f64>],
    included: &'a str,
) -> impl Iterator<Item = String> + 'a {
    errors.iter().enumerate().map(move |(k, error)| {
        let number = k + 1;
        match error {
            Some(error) => format!(
                "experiment {number} has a discretisation error of {:.1} %{included}",
                100.0 * error
            ),
            None => format!(
                "the discretisation error of experiment {number} is unknown{}",
                match included.is_empty() {
                    true => "",
                    false => "; the intervals leave it out",
                }
            ),
        }
    })
}

/// Formats a combination: a product of powers for unknowns with logarithmic scales, a sum otherwise.
fn combination(scaled: &[ScaledUnknown], weights: &[f64]) -> String {
    let large: Vec<(&ScaledUnknown, f64)> = scaled
        .iter()
        .zip(weights)
        .filter(|(_, weight)| weight.abs() >= SMALL_WEIGHT)
        .map(|(unknown, weight)| (unknown, *weight))
        .collect();
    let are_powers = large.iter().all(|(unknown, _)| unknown.is_logarithmic());
    let term = |(unknown, weight): &(&ScaledUnknown, f64)| match (*weight == 1.0, are_powers) {
        (true, true) => unknown.factor_name(),
        (true, false) => unknown.name.clone(),
        (false, true) => format!("{}^{weight:.2}", unknown.factor_name()),
        (false, false) => format!("{weight:.2} {}", unknown.name),
    };
    let terms: Vec<String> = large.iter().map(term).collect();
    match (terms.len(), are_powers) {
        (1, _) => terms.concat(),
        (_, true) => format!("the product {}", terms.join(" × ")),
        (_, false) => format!("the combination of {}", terms.join(" and ")),
    }
}
