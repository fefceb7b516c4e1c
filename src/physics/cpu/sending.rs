//! Loads on their way to the thread that steps a body.

use super::loads::Attachment;
use super::stepped::{LoadChange, Stepped};
use super::tools::Guided;
use super::worker::{Errand, Worker};
use crate::Result;
use crate::physics::loads::LoadVersions;
use crate::physics::{Grip, Held, Loads, ToolPose};
use glam::DVec3;

/// Sends the loads that have changed since those of the versions in `sent`.
pub(in crate::physics) fn send_loads<B: Stepped + ?Sized>(
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
    let change = LoadChange {
        gravity: loads.gravity(),
        pinned: differs(|v| v.held).then(|| loads.pinned().to_vec()),
        forces: differs(|v| v.forces).then(|| loads.forces().to_vec()),
        attachments: differs(|v| v.grabs).then(|| attachments(loads)),
        levels: differs(|v| v.levels).then(|| loads.levels().to_vec()),
        tools: differs(|v| v.tools).then(|| tools(loads)),
    };
    *sent = Some(versions);
    worker.ask(Errand::Loads(Box::new(change)))
}

/// All loads.
pub(super) fn all_loads(loads: &Loads) -> LoadChange {
    LoadChange {
        gravity: loads.gravity(),
        pinned: Some(loads.pinned().to_vec()),
        forces: Some(loads.forces().to_vec()),
        attachments: Some(attachments(loads)),
        levels: Some(loads.levels().to_vec()),
        tools: Some(tools(loads)),
    }
}

/// Where tools go, in metres.
fn tools(loads: &Loads) -> Vec<Guided> {
    let (frame, unit) = loads.frame_and_unit();
    let metres = |pose: &ToolPose| ToolPose::new((pose.place() - frame.origin) * unit, pose.turn());
    let all = loads.tools().iter();
    all.map(|(pose, jumps)| (metres(pose), *jumps)).collect()
}

/// The nodes that grabs hold or pull, in metres.
fn attachments(loads: &Loads) -> Vec<Attachment> {
    let (frame, unit) = loads.frame_and_unit();
    let metres = |p: DVec3| (p - frame.origin) * unit;
    let led = loads.led().iter().flat_map(|led| {
        led.each().map(|(node, place, velocity)| Attachment::Lead {
            node,
            place: metres(place),
            velocity: velocity * unit,
        })
    });
    let held = loads.grabs.iter().flat_map(|grab| grab.held());
    let held = held.map(|Held { node, place, grip }| match grip {
        Grip::Follow => Attachment::Hold {
            node,
            place: metres(place),
        },
        Grip::Spring { stiffness, limit } => Attachment::Pull {
            node,
            target: metres(place),
            stiffness,
            limit,
        },
    });
    led.chain(held).collect()
}
