//! The mesher against known geometry.

mod labels;
mod scans;
mod solids;
mod support;
mod thin;
