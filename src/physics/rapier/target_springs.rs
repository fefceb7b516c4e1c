//! Springs from nodes to targets: motors between the node's body and a kinematic body. rapier's
//! motors act on the node's own mass instead of the effective mass of the structure attached to it,
//! so a node comes to rest off its target; the error decreases with the step.

use super::rigid_region::{RigidRegion, RigidRegionBody};
use super::soft_body_model::SoftBodyModel;
use super::units::Scale;
use crate::physics::cpu::NodeConstraint;
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{
    GenericJointBuilder, ImpulseJointHandle, JointAxesMask, JointAxis, MotorModel, PhysicsWorld,
    RigidBodyBuilder, RigidBodyHandle, SoftBodyHandle,
};

const AXES: [JointAxis; 3] = [JointAxis::LinX, JointAxis::LinY, JointAxis::LinZ];

/// A zero-length spring from a node to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TargetSpring {
    pub node: u32,
    /// Target position, m.
    pub target: DVec3,
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Maximum force, N.
    pub limit: f64,
}

impl TargetSpring {
    /// The springs among `attachments`.
    pub fn of(attachments: &[NodeConstraint]) -> impl Iterator<Item = TargetSpring> {
        attachments.iter().filter_map(|a| match *a {
            NodeConstraint::Spring {
                node,
                target,
                stiffness,
                limit,
            } => Some(TargetSpring {
                node,
                target,
                stiffness,
                limit,
            }),
            _ => None,
        })
    }

    /// Whether all parameters except the target are equal.
    pub fn same_parameters(&self, other: &TargetSpring) -> bool {
        let target = self.target;
        *self == TargetSpring { target, ..*other }
    }
}

/// The attachment of a spring: a body of rapier and a point on it.
pub(super) struct SpringAnchor {
    body: RigidBodyHandle,
    arm: Vector,
    /// The particle, if the node is one.
    particle: Option<usize>,
}

impl SpringAnchor {
    /// A node that is a particle; `None` if it does not exist.
    pub fn particle(
        physics: &mut PhysicsWorld,
        body: SoftBodyHandle,
        matter: &SoftBodyModel,
        node: u32,
    ) -> Option<SpringAnchor> {
        let particle = matter.particles[node as usize]?;
        let cluster = physics.add_soft_body_cluster(body, &[particle])?;
        Some(SpringAnchor {
            body: physics.soft_bodies[body].cluster_proxy(cluster)?,
            arm: Vector::ZERO,
            particle: Some(particle as usize),
        })
    }

    /// A node of a rigid region.
    pub fn bone(
        bone: &RigidRegion,
        body: &RigidRegionBody,
        node: u32,
        scale: Scale,
    ) -> Option<SpringAnchor> {
        let own = bone.nodes.binary_search(&node).ok()?;
        Some(SpringAnchor {
            body: body.handle,
            arm: scale.vector(bone.lever_arms[own]),
            particle: None,
        })
    }

    /// The present position.
    fn place(&self, physics: &PhysicsWorld, soft: SoftBodyHandle) -> Vector {
        match self.particle {
            Some(i) => physics.soft_bodies[soft].particle_position(i),
            None => *physics.bodies[self.body].position() * self.arm,
        }
    }
}

/// A spring in a world.
pub(super) struct AttachedSpring {
    hook: SpringAnchor,
    /// Maximum force, in rapier's units.
    limit: f32,
    anchor: RigidBodyHandle,
    joint: ImpulseJointHandle,
}

impl AttachedSpring {
    /// Attaches `spring` to its node.
    pub fn new(
        physics: &mut PhysicsWorld,
        hook: SpringAnchor,
        spring: &TargetSpring,
        scale: Scale,
    ) -> AttachedSpring {
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
        AttachedSpring {
            limit: limit.min(f64::from(f32::MAX)) as f32,
            joint: physics.insert_impulse_joint(anchor, hook.body, joint),
            hook,
            anchor,
        }
    }

    /// Sets the target (m) for the next step. Motors have a force limit per axis; the spring's
    /// limit is distributed in the direction of the pull.
    pub fn set_target(
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
