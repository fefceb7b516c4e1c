//! Error messages that several engines give.

/// The message of a step that inverts tets of a body that had none inverted.
pub(in crate::physics) const INVERTED_TETS_MESSAGE: &str =
    "the step inverted tets, so its forces and stresses would be meaningless";

/// Message for tools that press on a body that cannot yield.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against the supports of the body that boundary points stay inside them; increase the clearance, or reduce the tool displacement";
