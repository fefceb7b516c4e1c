//! Advice for failed steps.

use super::step_limit::{largest_stable_step, limit_with_terms};
use crate::physics::{DiscreteModel, Discretisation, NodeTerm, SolverKind};
use std::sync::Arc;

/// Ratio of a safe explicit step to the largest stable one at rest, for springs.
const SPRING_STEP_RATIO: f64 = 0.9;

/// Ratio of the step that is advised for springs to the largest stable one.
const ADVISED_SPRING_STEP_RATIO: f64 = 0.95;

/// As [`SPRING_STEP_RATIO`], for finite elements, which stiffen by an order of magnitude where a
/// load crushes or stretches them.
const ELEMENT_STEP_RATIO: f64 = 0.2;

/// Returns the ratio of a safe explicit step to the largest stable one at rest.
pub(crate) fn safe_step_ratio(model: Option<&DiscreteModel>) -> f64 {
    match model.and_then(DiscreteModel::elements) {
        Some(_) => ELEMENT_STEP_RATIO,
        None => SPRING_STEP_RATIO,
    }
}

/// Returns advice for failed steps of `dt` seconds.
pub(in crate::physics) fn time_step_advice(
    kind: SolverKind,
    dt: f64,
    (model, terms): (&DiscreteModel, &[Arc<dyn NodeTerm>]),
    pinned: &[bool],
) -> String {
    let limit = largest_stable_step(model, pinned, kind);
    let ratio = safe_step_ratio(Some(model));
    let advised = match model.discretisation {
        Discretisation::Springs(_) => ADVISED_SPRING_STEP_RATIO,
        Discretisation::Elements(_) => ratio,
    };
    match limit.map(|limit| limit_with_terms(limit, model, terms)) {
        None => format!(
            "use a --dt below {dt}, less stiffness or more damping, and check the units of the mesh"
        ),
        Some(0.0) => {
            "explicit Euler is never stable without damping; use --solver implicit or symplectic"
                .to_owned()
        }
        // A chosen step is exactly at this ratio.
        Some(limit) if dt < 1.001 * ratio * limit => format!(
            "the largest stable step at rest is {limit:.3e} s; check for excessive forces or velocities, or use --solver implicit"
        ),
        Some(limit) => format!(
            "use --dt {} or less, or --solver implicit",
            floor_to_digits(advised * limit)
        ),
    }
}

/// Rounds `x` down to two significant digits.
fn floor_to_digits(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 1.0);
    // Through text, to remove the rounding error of the multiplication.
    format!("{:.1e}", (x / unit).floor() * unit)
        .parse()
        .unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_never_rounds_up() {
        assert_eq!(floor_to_digits(0.000349), 0.00034);
        assert_eq!(floor_to_digits(1.0), 1.0);
    }
}
