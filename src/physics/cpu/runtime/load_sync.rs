//! Sends changed loads to the thread that steps a body.

use super::steppable::{LoadUpdate, Steppable};
use super::worker::{Worker, WorkerCommand};
use crate::Result;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::runtime::steppable::ToolTarget;
use crate::physics::loads::LoadVersions;
use crate::physics::{GrabMode, GrabbedNode, Loads, ToolPose};
use glam::DVec3;

/// Sends the loads that have changed since the versions in `sent`.
pub(in crate::physics) fn send_loads<B: Steppable + ?Sized>(
    loads: &Loads,
    sent: &mut Option<LoadVersions>,
    worker: &mut Worker<B>,
) -> Result<()> {
    let versions = loads.versions;
    if *sent == Some(versions) {
        return Ok(());
    }
    let known = *sent;
    let differs = |of: fn(&LoadVersions) -> u64| known.is_none_or(|k| of(&k) != of(&versions));
    let change = LoadUpdate {
        gravity: loads.gravity(),
        pinned: differs(|v| v.constraints).then(|| loads.pinned().to_vec()),
        forces: differs(|v| v.forces).then(|| loads.forces().to_vec()),
        attachments: differs(|v| v.grabs).then(|| node_constraints(loads)),
        levels: differs(|v| v.levels).then(|| loads.amplitudes().to_vec()),
        tools: differs(|v| v.tools).then(|| tools(loads)),
    };
    *sent = Some(versions);
    worker.enqueue(WorkerCommand::Loads(Box::new(change)))
}

/// Returns an update with all loads.
pub(in crate::physics::cpu) fn full_load_update(loads: &Loads) -> LoadUpdate {
    LoadUpdate {
        gravity: loads.gravity(),
        pinned: Some(loads.pinned().to_vec()),
        forces: Some(loads.forces().to_vec()),
        attachments: Some(node_constraints(loads)),
        levels: Some(loads.amplitudes().to_vec()),
        tools: Some(tools(loads)),
    }
}

/// Returns the loads that a motion may change before a step.
pub(in crate::physics) fn step_load_update(loads: &Loads) -> LoadUpdate {
    LoadUpdate {
        gravity: loads.gravity(),
        pinned: None,
        forces: None,
        attachments: (!loads.prescribed_motions().is_empty()).then(|| node_constraints(loads)),
        levels: (!loads.amplitudes().is_empty()).then(|| loads.amplitudes().to_vec()),
        tools: (!loads.tools().is_empty()).then(|| tools(loads)),
    }
}

/// Returns the tool targets, in metres.
fn tools(loads: &Loads) -> Vec<ToolTarget> {
    let (frame, unit) = loads.frame_and_unit();
    let metres =
        |pose: &ToolPose| ToolPose::new((pose.position() - frame.origin) * unit, pose.rotation());
    let all = loads.tools().iter();
    all.map(|(pose, teleport_count)| (metres(pose), *teleport_count))
        .collect()
}

/// Returns the constraints and springs of nodes from grabs and prescribed motions, in metres.
fn node_constraints(loads: &Loads) -> Vec<NodeConstraint> {
    let (frame, unit) = loads.frame_and_unit();
    let metres = |p: DVec3| (p - frame.origin) * unit;
    let prescribed = loads.prescribed_motions().iter().flat_map(|motion| {
        motion
            .iter()
            .map(|(node, place, velocity)| NodeConstraint::Prescribed {
                node,
                place: metres(place),
                velocity: velocity * unit,
            })
    });
    let grabbed = loads.grabs.iter().flat_map(|grab| grab.held());
    let grabbed = grabbed.map(|GrabbedNode { node, place, grip }| match grip {
        GrabMode::Follow => NodeConstraint::Fixed {
            node,
            place: metres(place),
        },
        GrabMode::Spring { stiffness, limit } => NodeConstraint::Spring {
            node,
            target: metres(place),
            stiffness,
            limit,
        },
    });
    prescribed.chain(grabbed).collect()
}
