//! Joints of rapier between rigid regions, or from a region to the world.

use super::rigid_region::{RigidRegion, RigidRegionBody};
use super::units::Scale;
use crate::physics::{Joint, JointKind};
use crate::{Error, Result};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{
    FixedJointBuilder, GenericJoint, PhysicsWorld, PrismaticJointBuilder, RevoluteJointBuilder,
    RigidBodyBuilder, SphericalJointBuilder,
};

/// A joint between rigid regions, given by index; `None` is the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct RegionJoint {
    bones: (usize, Option<usize>),
    /// Anchor, m.
    at: DVec3,
    kind: JointKind,
    /// Metres per file unit.
    unit: f64,
}

impl RegionJoint {
    /// `joint`, located at `at` (m), of a body with these rigid regions.
    ///
    /// # Errors
    /// [`Error::Input`] if a region is not rigid, or both belong to one rigid body.
    pub fn new(joint: &Joint, at: DVec3, bones: &[RigidRegion], unit: f64) -> Result<RegionJoint> {
        let find = |label: i64| {
            let mut those = bones.iter().enumerate();
            let found = those.find(|(_, bone)| bone.labels.contains(&label));
            found.map(|(b, _)| b).ok_or_else(|| {
                Error::Input(format!(
                    "joined region {label} is not rigid; set [material] NAME = {{ rigid = true }}, or give the [[tool]] a mass"
                ))
            })
        };
        let (a, b) = joint.regions;
        let bones = (find(a)?, b.map(find).transpose()?);
        if bones.1 == Some(bones.0) {
            return Err(Error::Input(format!(
                "cannot join regions {a} and {}: they share nodes and form one rigid body; separate them with [mesh] part",
                b.unwrap_or(a)
            )));
        }
        Ok(RegionJoint {
            bones,
            at,
            kind: joint.kind,
            unit,
        })
    }

    /// Inserts the joint into the world, whose rigid regions are at rest.
    pub fn insert(
        &self,
        physics: &mut PhysicsWorld,
        bones: &[RigidRegion],
        bodies: &[RigidRegionBody],
        scale: Scale,
    ) {
        let arm = |b: usize| scale.vector(self.at - bones[b].centre);
        let (second, to) = (self.bones.0, self.bones.1);
        // Angles and displacements are those of the second body, so the world comes first.
        let (first, anchors, second) = match to {
            Some(b) => (
                bodies[second].handle,
                [arm(second), arm(b)],
                bodies[b].handle,
            ),
            None => {
                let world = RigidBodyBuilder::fixed().translation(scale.vector(self.at));
                let world = physics.insert_body(world);
                (world, [Vector::ZERO, arm(second)], bodies[second].handle)
            }
        };
        let axis = |axis: DVec3| {
            let [x, y, z] = axis.normalize().as_vec3().to_array();
            Vector::new(x, y, z)
        };
        let mut joint: GenericJoint = match self.kind {
            JointKind::Fixed => FixedJointBuilder::new().build().into(),
            JointKind::Ball => SphericalJointBuilder::new().build().into(),
            JointKind::Hinge(about, limits) => {
                let hinge = RevoluteJointBuilder::new(axis(about));
                match limits {
                    Some(limits) => hinge.limits(limits.map(|a| a as f32)).build().into(),
                    None => hinge.build().into(),
                }
            }
            JointKind::Slider(along, limits) => {
                let slider = PrismaticJointBuilder::new(axis(along));
                let local = |x: f64| (x * self.unit / scale.length) as f32;
                match limits {
                    Some(limits) => slider.limits(limits.map(local)).build().into(),
                    None => slider.build().into(),
                }
            }
        };
        joint.set_local_anchor1(anchors[0]);
        joint.set_local_anchor2(anchors[1]);
        joint.set_contacts_enabled(false);
        physics.insert_impulse_joint(first, second, joint);
    }
}
