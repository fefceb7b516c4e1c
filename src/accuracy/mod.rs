//! Error estimates of the numbers that Palpate reports.
//!
//! The mesh part of an error is the difference to the solution in a finer space that contains the
//! reported one: quadratic tets on the same mesh for linear ones, each tet divided into eight for
//! quadratic ones (hierarchical estimate; Bank & Weiser 1985, "Some a posteriori error estimators for
//! elliptic partial differential equations"). The equilibrium there is found by Newton's method from
//! the reported one, with contact and large strain, so that the estimate holds for any number.

mod error_field;
mod finer_body;
mod recovery;
mod refined_stage;
mod refinement;
mod rest;

pub(crate) use error_field::{error_stage, with_error_field, with_size_field};
#[cfg(any(feature = "study", feature = "identify"))]
pub(crate) use finer_body::EQUILIBRIUM_TOLERANCE;
pub(crate) use finer_body::{FinerBody, RestBody, quasi_static_step, settle};
pub(crate) use recovery::recovery_errors;
pub(crate) use refined_stage::{MAX_RAISED_TETS, first_mesh, of_order, refined_mesh};
pub use refinement::Round;
pub(crate) use refinement::{Refinable, Refined, Solution, refine};
#[cfg(feature = "study")]
pub(crate) use rest::errors_at_rest;
pub use rest::{ForceError, RestErrors};

use crate::mesh::ElementOrder;
use crate::number_format::with_error;
use serde::Serialize;

/// Share of an error below which a part of it is not named.
const NEGLIGIBLE: f64 = 0.05;

/// Estimated parts of the error of a number, in its unit and not negative. Their sum bounds the error
/// in most cases (`docs/validation/trust.md` has the share).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorParts {
    /// Error of the mesh: the difference to the finer space, times a safety factor.
    pub mesh: f64,
    /// Error of inertia and of the path: the difference to the equilibrium under the present loads, and
    /// the amplitude that the kinetic energy allows.
    pub time: f64,
    /// Error of Newton's method: the last change when its iterations are continued.
    pub solver: f64,
    /// Error of the gap that the contact barrier keeps.
    pub contact: f64,
    /// Error of the part that lies on a table: its faces do not have exactly the area of the shape's
    /// region.
    pub support: f64,
}

impl ErrorParts {
    /// The whole error: the sum of the parts.
    pub fn total(&self) -> f64 {
        self.mesh + self.time + self.solver + self.contact + self.support
    }

    /// Returns these parts times `factor`.
    pub fn scaled(&self, factor: f64) -> ErrorParts {
        ErrorParts {
            mesh: factor * self.mesh,
            time: factor * self.time,
            solver: factor * self.solver,
            contact: factor * self.contact,
            support: factor * self.support,
        }
    }

    /// Formats a number in `unit` with this error, without the digits beyond it: `0.262 N ± 0.006`.
    pub fn around(&self, x: f64, unit: &str) -> String {
        let [x, error] = with_error(x, self.total());
        format!("{x} {unit} ± {error}")
    }

    /// Formats the parts that are not negligible: `mesh 0.005, time 0.001`.
    pub fn in_words(&self) -> String {
        let parts = [
            ("mesh", self.mesh),
            ("time", self.time),
            ("solver", self.solver),
            ("contact", self.contact),
            ("support", self.support),
        ];
        let large = |(_, part): &(_, f64)| *part > NEGLIGIBLE * self.total();
        let texts = parts.into_iter().filter(large).map(|(name, part)| {
            let [_, part] = with_error(part, part);
            format!("{name} {part}")
        });
        texts.collect::<Vec<_>>().join(", ")
    }
}

/// Returns the safety factor of the mesh part for elements of `order`: the part of the error that the
/// finer space itself still has (`palpate study trust`).
pub(crate) fn mesh_factor(order: ElementOrder) -> f64 {
    match order {
        ElementOrder::Linear => 2.5,
        ElementOrder::Quadratic => 2.5,
    }
}
