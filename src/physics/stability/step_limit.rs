//! The largest stable step of explicit schemes for a discrete model.

use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::node_term::NodeTerm;
use crate::physics::model::solver_kind::SolverKind;
use crate::physics::stability::linearised_model::LinearisedModel;
use std::sync::Arc;

/// Returns the largest stable time step of `solver` for `model` at rest with the nodes marked in
/// `pinned` fixed, in seconds; `None` for implicit Euler, which has none.
///
/// From the eigenvalues of the scheme's step matrix, including damping: see
/// [`LinearisedModel::largest_step`]. Without damping it is 2/ω_max for the symplectic schemes, and
/// 0 for explicit Euler, which is never stable. A body stretched far from rest may need a smaller
/// step.
pub fn largest_stable_step(
    model: &DiscreteModel,
    pinned: &[bool],
    solver: SolverKind,
) -> Option<f64> {
    let limit = LinearisedModel::new(model, pinned).largest_step(solver)?;
    Some(limit.step)
}

/// Returns a step that is stable with `terms`, given the `limit` without them: adds the largest ω²
/// of the terms to that of the springs, ω = 2/h.
pub(in crate::physics) fn limit_with_terms(
    limit: f64,
    model: &DiscreteModel,
    terms: &[Arc<dyn NodeTerm>],
) -> f64 {
    if limit == 0.0 {
        return 0.0;
    }
    let masses = || model.masses.iter().filter(|m| **m > 0.0);
    let squares = terms.iter().map(|term| {
        let each = masses().map(|m| term.max_stiffness(*m) / m);
        each.fold(0.0, f64::max)
    });
    let square = 4.0 / (limit * limit) + squares.sum::<f64>();
    2.0 / square.sqrt()
}
