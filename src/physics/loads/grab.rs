//! Grabs: nodes that follow a target exactly, or are pulled by springs with a force limit.

use super::reactions::GrabbedNode;
use crate::mesh::LocalFrame;
use crate::physics::loads::grab_state::{GrabState, GrabsState};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt;

/// Maximum distance of a target from the body's centre, in body sizes.
const MAX_TARGET_DISTANCE: f64 = 100.0;

/// The kind of constraint by which a grab holds its nodes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum GrabMode {
    /// The nodes keep their offsets from the target exactly, whatever the forces.
    Follow,
    /// A spring from each node to its offset from the target.
    Spring {
        /// Total stiffness of all springs, N/m.
        stiffness: f64,
        /// Maximum total force of all springs, N.
        limit: f64,
    },
}

impl fmt::Display for GrabMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GrabMode::Follow => f.write_str("nodes that follow the target"),
            GrabMode::Spring { stiffness, limit } => {
                write!(f, "springs of {stiffness} N/m up to {limit} N")
            }
        }
    }
}

/// Identifies a grab of a body.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub struct GrabId(u32);

impl GrabId {
    /// The grab with this number.
    pub(in crate::physics) fn from_raw(number: u32) -> GrabId {
        GrabId(number)
    }
}

/// The nodes of a grab and its target.
#[derive(Clone, Debug)]
pub(in crate::physics) struct Grab {
    pub nodes: Vec<u32>,
    /// Offset of each node from the target, in file units.
    pub offsets: Vec<DVec3>,
    pub target: DVec3,
    pub grip: GrabMode,
}

impl Grab {
    /// Its nodes with their constraints.
    pub fn held(&self) -> impl Iterator<Item = GrabbedNode> {
        let share = self.nodes.len() as f64;
        let grip = match self.grip {
            GrabMode::Follow => GrabMode::Follow,
            GrabMode::Spring { stiffness, limit } => GrabMode::Spring {
                stiffness: stiffness / share,
                limit: limit / share,
            },
        };
        let nodes = self.nodes.iter().zip(&self.offsets);
        nodes.map(move |(node, offset)| GrabbedNode {
            node: *node,
            place: self.target + *offset,
            grip,
        })
    }
}

/// The grabs of a body.
#[derive(Clone, Debug)]
pub(in crate::physics) struct Grabs {
    frame: LocalFrame,
    grabs: BTreeMap<GrabId, Grab>,
    next: u32,
}

impl Grabs {
    pub(in crate::physics) fn new(frame: LocalFrame) -> Grabs {
        Grabs {
            frame,
            grabs: BTreeMap::new(),
            next: 0,
        }
    }

    /// Iterates over the grabs.
    pub(in crate::physics) fn iter(&self) -> impl Iterator<Item = &Grab> {
        self.grabs.values()
    }

    /// Grabs the nodes within `radius` of `centre` for which `free` is true; file units.
    pub(in crate::physics) fn add(
        &mut self,
        positions: &[DVec3],
        free: impl Fn(usize) -> bool,
        centre: DVec3,
        radius: f64,
        grip: GrabMode,
    ) -> Result<GrabId> {
        let sound = match grip {
            GrabMode::Follow => true,
            GrabMode::Spring { stiffness, limit } => {
                stiffness.is_finite() && stiffness > 0.0 && limit > 0.0
            }
        };
        if !(sound && centre.is_finite() && radius.is_finite() && radius >= 0.0) {
            return Err(Error::Input(format!(
                "invalid grab: centre {centre}, radius {radius}, {grip}; give a finite centre, a radius ≥ 0, and a stiffness and limit > 0"
            )));
        }
        let nodes: Vec<u32> = (0..positions.len())
            .filter(|i| free(*i) && positions[*i].distance(centre) <= radius)
            .map(|i| i as u32)
            .collect();
        if nodes.is_empty() {
            let nearest = (0..positions.len())
                .filter(|i| free(*i))
                .map(|i| positions[i].distance(centre))
                .fold(f64::INFINITY, f64::min);
            return Err(Error::Input(format!(
                "nothing to grab within {radius} of {centre}: the nearest free node is {nearest:.4} away"
            )));
        }
        let id = GrabId(self.next);
        self.next += 1;
        let offsets = nodes
            .iter()
            .map(|i| positions[*i as usize] - centre)
            .collect();
        let grab = Grab {
            nodes,
            offsets,
            target: centre,
            grip,
        };
        self.grabs.insert(id, grab);
        Ok(id)
    }

    /// Moves the target of a grab, in file units. Returns whether it has changed.
    pub(in crate::physics) fn set_target(&mut self, id: GrabId, target: DVec3) -> Result<bool> {
        let far = target.distance(self.frame.origin) > MAX_TARGET_DISTANCE * self.frame.scale;
        if !target.is_finite() || far {
            return Err(Error::Input(format!(
                "invalid grab target {target}: {}; the previous target is kept",
                if far && target.is_finite() {
                    "it is farther away than 100 body sizes"
                } else {
                    "it is not finite"
                }
            )));
        }
        let grab = self.grabs.get_mut(&id).ok_or_else(unknown_grab_error)?;
        let moved = grab.target != target;
        grab.target = target;
        Ok(moved)
    }

    /// The nodes held by a grab.
    pub(in crate::physics) fn held_by(&self, id: GrabId) -> Result<Vec<GrabbedNode>> {
        let grab = self.grabs.get(&id).ok_or_else(unknown_grab_error)?;
        Ok(grab.held().collect())
    }

    /// The serialisable state of all grabs.
    pub(in crate::physics) fn state(&self) -> GrabsState {
        let held = self.grabs.iter().map(|(id, grab)| GrabState {
            id: *id,
            nodes: grab.nodes.clone(),
            offsets: grab.offsets.iter().map(|o| o.to_array()).collect(),
            target: grab.target.to_array(),
            grip: grab.grip,
        });
        GrabsState {
            held: held.collect(),
            next: self.next,
        }
    }

    /// Restores a state from [`Grabs::state`] for a body with `nodes` nodes.
    pub(in crate::physics) fn set_state(&mut self, state: &GrabsState, nodes: usize) -> Result<()> {
        let strange = |held: &GrabState| {
            held.nodes.len() != held.offsets.len()
                || held.nodes.iter().any(|v| *v as usize >= nodes)
                || held.id.0 >= state.next
        };
        if state.held.iter().any(strange) {
            return Err(Error::Input(
                "the saved grabs are of another body, or damaged".into(),
            ));
        }
        let grabs = state.held.iter().map(|held| {
            let grab = Grab {
                nodes: held.nodes.clone(),
                offsets: held.offsets.iter().map(|o| DVec3::from(*o)).collect(),
                target: held.target.into(),
                grip: held.grip,
            };
            (held.id, grab)
        });
        self.grabs = grabs.collect();
        self.next = state.next;
        Ok(())
    }

    /// Releases a grab. Returns the number of its nodes.
    pub(in crate::physics) fn release(&mut self, id: GrabId) -> Result<usize> {
        let grab = self.grabs.remove(&id).ok_or_else(unknown_grab_error)?;
        Ok(grab.nodes.len())
    }

    /// Whether there are any grabs.
    pub(in crate::physics) fn any(&self) -> bool {
        !self.grabs.is_empty()
    }

    /// The nodes that follow a target exactly.
    pub(in crate::physics) fn held(&self) -> impl Iterator<Item = u32> {
        let follow = self.grabs.values().filter(|g| g.grip == GrabMode::Follow);
        follow.flat_map(|g| g.nodes.iter().copied())
    }
}

/// The error for an unknown grab.
pub(in crate::physics) fn unknown_grab_error() -> Error {
    Error::Input("unknown grab: it does not exist or was released".into())
}
