//! The mesher against known geometry.

mod labels;
mod scans;
mod sizes;
mod solids;
mod support;
mod thin;
