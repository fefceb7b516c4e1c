//! Error messages that several engines give.

/// Message for tools that press on a body that cannot yield.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against the supports of the body that boundary points stay inside them; increase the clearance, or reduce the tool displacement";
