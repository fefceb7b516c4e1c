//! Messages of errors that several engines give.

/// What is told of tools that the body cannot get out of the way of.
pub(in crate::physics) const TOOLS_OVERCONSTRAINED_MESSAGE: &str = "tools press so hard against what holds the body that points of its boundary stay inside them; leave the body more room, or let the tools go less far";
