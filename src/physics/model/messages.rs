//! Messages of errors that several engines give.

/// The message of a step that inverts tets of a body that had none inverted.
pub(in crate::physics) const INVERTED_TETS_MESSAGE: &str =
    "tets turned inside out in this step, so its forces and stresses would mean nothing";

/// What is told of tools that the body cannot get out of the way of.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against what holds the body that points of its boundary stay inside them; leave the body more room, or let the tools go less far";
