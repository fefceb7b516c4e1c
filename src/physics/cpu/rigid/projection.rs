//! The projection of linear solves onto the modes of rigid bodies.

use super::bodies::RigidBodies;
use super::pose::{DegreesOfFreedom, Pose};
use crate::physics::cpu::linear::rigid_projection::{BlockPose, RigidProjection};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;

impl RigidBodies {
    /// Creates the projection for these bodies, the last groups of `plan`.
    pub fn projection<T: Real>(&self, plan: &Partition) -> RigidProjection<T> {
        let nodes: Vec<_> = self.bodies.iter().map(|body| body.nodes.clone()).collect();
        RigidProjection::new(plan.groups() - nodes.len(), &nodes)
    }

    /// Updates the projection to `poses`.
    pub fn update_projection<T: Real>(&self, poses: &[Pose], projection: &mut RigidProjection<T>) {
        for (b, (body, pose)) in self.bodies.iter().zip(poses).enumerate() {
            let (pivot, rotation_projector) = body.pivot(pose);
            let over = 1.0 / body.radius();
            let fixed = body.freedom == DegreesOfFreedom::Fixed;
            let nodes = body.nodes.start - self.first..body.nodes.end - self.first;
            let pose = BlockPose {
                lever_arms: &self.lever_arms[nodes],
                pivot,
                scale: if fixed { 0.0 } else { over },
                rotation: pose.rotation,
                rotation_projector,
                free: body.freedom == DegreesOfFreedom::Free,
            };
            projection.set_pose(b, &pose);
        }
    }
}
