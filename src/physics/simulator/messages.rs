//! Errors and messages that several engines give.

use crate::Error;
use crate::physics::SolverKind;

/// The message of a step that inverts tets of a body that had none inverted.
pub(in crate::physics) const INVERTED_TETS_MESSAGE: &str =
    "the step inverted tets, so its forces and stresses would be meaningless";

/// Message for tools that press on a body that cannot yield.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against the supports of the body that boundary points stay inside them; increase the clearance, or reduce the tool displacement";

/// The error of using `kind`, one of [`SolverKind::ELEMENT_ONLY`], for a body of springs or on
/// another engine than the CPU.
pub(in crate::physics) fn requires_elements_error(kind: SolverKind) -> Error {
    Error::Input(format!(
        "{kind} supports only finite elements on the CPU; use --material neo-hookean (or corotated) and --engine cpu, or --solver implicit"
    ))
}
