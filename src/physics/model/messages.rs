//! Messages of errors that several engines give.

/// What is told of tools that the body cannot get out of the way of.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against the supports of the body that boundary points stay inside them; increase the clearance, or reduce the tool displacement";
