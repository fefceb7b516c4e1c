//! Springs from nodes to targets: motors between a node, a body to rapier, and one that is led.
//! rapier has them pull at the node's own mass and not at all that hangs on it, so that a node comes
//! to rest off its place, the less the shorter the step.

use super::matter::Matter;
use super::rigid::{Bone, BoneBody};
use super::scale::Scale;
use crate::physics::cpu::Attachment;
use glam::DVec3;
use rapier3d::math::Vector;
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

/// What a spring hangs on: a body of rapier's, and where on it.
pub(super) struct Hook {
    body: RigidBodyHandle,
    arm: Vector,
    /// The particle that it is, if it is one.
    particle: Option<usize>,
}

impl Hook {
    /// A node that is soft; `None` for one that is not there.
    pub fn particle(
        physics: &mut PhysicsWorld,
        body: SoftBodyHandle,
        matter: &Matter,
        node: u32,
    ) -> Option<Hook> {
        let particle = matter.particles[node as usize]?;
        let cluster = physics.add_soft_body_cluster(body, &[particle])?;
        Some(Hook {
            body: physics.soft_bodies[body].cluster_proxy(cluster)?,
            arm: Vector::ZERO,
            particle: Some(particle as usize),
        })
    }

    /// A node of a rigid region.
    pub fn bone(bone: &Bone, body: &BoneBody, node: u32, scale: Scale) -> Option<Hook> {
        let own = bone.nodes.binary_search(&node).ok()?;
        Some(Hook {
            body: body.handle,
            arm: scale.vector(bone.arms[own]),
            particle: None,
        })
    }

    /// Where it is.
    fn place(&self, physics: &PhysicsWorld, soft: SoftBodyHandle) -> Vector {
        match self.particle {
            Some(i) => physics.soft_bodies[soft].particle_position(i),
            None => *physics.bodies[self.body].position() * self.arm,
        }
    }
}

/// A spring in a world.
pub(super) struct Hung {
    hook: Hook,
    /// In rapier's units.
    limit: f32,
    anchor: RigidBodyHandle,
    joint: ImpulseJointHandle,
}

impl Hung {
    /// Hangs `spring` on what it pulls at.
    pub fn new(physics: &mut PhysicsWorld, hook: Hook, spring: &Spring, scale: Scale) -> Hung {
        let anchor = RigidBodyBuilder::kinematic_position_based();
        let anchor = physics.insert_body(anchor.translation(scale.vector(spring.target)));
        let stiffness = (spring.stiffness / scale.mass) as f32;
        let mut joint = GenericJointBuilder::new(JointAxesMask::empty()).local_anchor2(hook.arm);
        for axis in AXES {
            joint = joint
                .motor_model(axis, MotorModel::ForceBased)
                .motor_position(axis, 0.0, stiffness, 0.0);
        }
        let limit = spring.limit / (scale.mass * scale.length);
        Hung {
            limit: limit.min(f64::from(f32::MAX)) as f32,
            joint: physics.insert_impulse_joint(anchor, hook.body, joint),
            hook,
            anchor,
        }
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
        let pull = to - self.hook.place(physics, body);
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
