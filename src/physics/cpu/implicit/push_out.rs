//! Pushing nodes and rigid bodies out of tools that they penetrate before a step.

use crate::physics::cpu::contact::tool_contact::ToolContact;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, add, to_v4};
use glam::DVec3;

/// Returns the displacements that push the nodes of a body at `u` out of its tools at their current
/// poses.
pub(in crate::physics::cpu) fn resolve_penetration<T: Real>(
    contact: &mut ToolContact<T>,
    u: &[V4<T>],
    free: &[T],
) -> Vec<(usize, DVec3)> {
    contact.push_out(u, free, [0.0, 0.0])
}

/// Pushes nodes, and each rigid body by the largest push of its nodes.
pub(in crate::physics::cpu) fn apply_push_out<T: Real>(
    pushed: Vec<(usize, DVec3)>,
    u: &mut [V4<T>],
    rigid: Option<&mut RigidBodies>,
) {
    let bodies = rigid.as_ref().map_or(0, |r| r.bodies.len());
    let mut shifts = vec![DVec3::ZERO; bodies];
    for (i, by) in pushed {
        match rigid.as_ref().and_then(|r| r.body_of(i)) {
            Some(b) if by.length() > shifts[b].length() => shifts[b] = by,
            Some(_) => {}
            None => u[i] = add(u[i], to_v4(by)),
        }
    }
    if let Some(rigid) = rigid.filter(|r| !r.is_empty()) {
        rigid.shift_current_poses(&shifts);
        rigid.write_nodes(&rigid.now, u);
    }
}
