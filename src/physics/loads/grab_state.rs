//! Grabs, as states keep them.

use super::grab::{GrabId, GrabMode};
use serde::{Deserialize, Serialize};

/// Nodes that follow a target, as states keep them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::physics) struct GrabState {
    pub id: GrabId,
    pub nodes: Vec<u32>,
    pub offsets: Vec<[f64; 3]>,
    pub target: [f64; 3],
    pub grip: GrabMode,
}

/// The grabs of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::physics) struct GrabsState {
    pub held: Vec<GrabState>,
    pub next: u32,
}
