//! Springs from nodes to targets: motors between a node, a body to rapier, and one that is led.
//! rapier has them pull at the node's own mass and not at all that hangs on it, so that a node comes
//! to rest off its place, the less the shorter the step.

use super::scale::Scale;
use crate::physics::cpu::Attachment;
use glam::DVec3;
use rapier3d::prelude::{
    GenericJointBuilder, ImpulseJointHandle, JointAxesMask, JointAxis, MotorModel, PhysicsWorld,
    RigidBodyBuilder, RigidBodyHandle, SoftBodyHandle,
};

const AXES: [JointAxis; 3] = [JointAxis::LinX, JointAxis::LinY, JointAxis::LinZ];

/// A spring without length from a node to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spring {
    pub node: u32,
    /// m.
    pub target: DVec3,
    /// N/m.
    pub stiffness: f64,
    /// The largest force, N.
    pub limit: f64,
}

impl Spring {
    /// Those among `attachments`.
    pub fn of(attachments: &[Attachment]) -> impl Iterator<Item = Spring> {
        attachments.iter().filter_map(|a| match *a {
            Attachment::Pull {
                node,
                target,
                stiffness,
                limit,
            } => Some(Spring {
                node,
                target,
                stiffness,
                limit,
            }),
            _ => None,
        })
    }

    /// Whether it is the other but for where it pulls to.
    pub fn is_like(&self, other: &Spring) -> bool {
        let target = self.target;
        *self == Spring { target, ..*other }
    }
}

/// A spring in a world.
pub(super) struct Hung {
    node: usize,
    /// In rapier's units.
    limit: f32,
    anchor: RigidBodyHandle,
    joint: ImpulseJointHandle,
}

impl Hung {
    /// Hangs `spring` on `body`; `None` for a node that is not there.
    pub fn new(
        physics: &mut PhysicsWorld,
        body: SoftBodyHandle,
        spring: &Spring,
        scale: Scale,
    ) -> Option<Hung> {
        let cluster = physics.add_soft_body_cluster(body, &[spring.node])?;
        let proxy = physics.soft_bodies[body].cluster_proxy(cluster)?;
        let anchor = RigidBodyBuilder::kinematic_position_based();
        let anchor = physics.insert_body(anchor.translation(scale.vector(spring.target)));
        let stiffness = (spring.stiffness / scale.mass) as f32;
        let mut joint = GenericJointBuilder::new(JointAxesMask::empty());
        for axis in AXES {
            joint = joint
                .motor_model(axis, MotorModel::ForceBased)
                .motor_position(axis, 0.0, stiffness, 0.0);
        }
        let limit = spring.limit / (scale.mass * scale.length);
        Some(Hung {
            node: spring.node as usize,
            limit: limit.min(f64::from(f32::MAX)) as f32,
            anchor,
            joint: physics.insert_impulse_joint(anchor, proxy, joint),
        })
    }

    /// Has it pull to `target` (m) in the next step. Motors have a limit along each axis: they share
    /// that of the spring as the pull does.
    pub fn aim(
        &self,
        physics: &mut PhysicsWorld,
        body: SoftBodyHandle,
        target: DVec3,
        scale: Scale,
    ) {
        let to = scale.vector(target);
        let pull = to - physics.soft_bodies[body].particle_position(self.node);
        physics.bodies[self.anchor].set_next_kinematic_translation(to);
        let Some(joint) = physics.impulse_joints.get_mut(self.joint, true) else {
            return;
        };
        let length = pull.length();
        for (axis, part) in AXES.into_iter().zip(pull.to_array()) {
            let share = match length > 0.0 {
                true => part.abs() / length,
                false => 1.0,
            };
            joint.data.set_motor_max_force(axis, share * self.limit);
        }
    }
}
