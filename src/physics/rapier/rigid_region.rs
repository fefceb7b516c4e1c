//! Rigid regions as rigid bodies of rapier, to which the particles of the surrounding soft tissue
//! are attached. The mass of a shared node is split in halves.

use super::units::Scale;
use crate::physics::cpu::closest_rotation;
use crate::physics::model::rigid_region::{
    DegreesOfFreedom, MassProperties as RegionMass, RigidBody,
};
use crate::physics::{DiscreteModel, LocalUnits};
use crate::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use rapier3d::math::{Matrix, Vector};
use rapier3d::prelude::{
    ColliderBuilder, Group, InteractionGroups, InteractionTestMode, MassProperties, PhysicsWorld,
    RigidBodyBuilder, RigidBodyHandle, RigidBodyType, SharedShape, SphericalJointBuilder,
    TriMeshFlags,
};
use std::collections::{BTreeMap, BTreeSet};

/// Fraction of the mass of a shared node that belongs to the rigid body.
const RIGID_MASS_FRACTION: f64 = 0.5;

/// A region is approximated by its convex hull if the hull's volume is at most this many times its
/// own.
const CONVEX_VOLUME_RATIO: f32 = 1.02;

/// Collision group of soft tissue. Rigid regions attached to soft tissue have a group of their own,
/// which does not collide with it.
const SOFT_GROUP: Group = Group::GROUP_1;
const HELD_BY_SOFT: Group = Group::GROUP_2;

/// A rigid region at rest.
#[derive(Clone, Debug)]
pub(super) struct RigidRegion {
    pub labels: BTreeSet<i64>,
    /// All of its nodes, ascending, their masses (kg), and their positions relative to the centre
    /// of mass (m).
    pub nodes: Vec<u32>,
    pub masses: Vec<f64>,
    pub lever_arms: Vec<DVec3>,
    /// Centre of mass, m.
    pub centre: DVec3,
    /// Radius of gyration, m.
    radius: f64,
    /// Mass properties in rapier's units, without the share of its particles.
    inertia: MassProperties,
    /// Boundary faces, in local node numbers.
    faces: Vec<[u32; 3]>,
    /// Whether no soft tissue is attached.
    pub is_isolated: bool,
}

impl RigidRegion {
    /// The rigid region of `body` of `model`, whose boundary is `boundary`; `soft` marks nodes
    /// that are particles too.
    ///
    /// # Errors
    /// [`Error::Input`] if the region is flat or massless.
    pub fn new(
        model: &DiscreteModel,
        body: &RigidBody,
        boundary: &[[u32; 3]],
        soft: &[bool],
        scale: Scale,
    ) -> Result<RigidRegion> {
        let units = LocalUnits::from_model(model);
        let moments = RegionMass::from_nodes(model, body, &units)?;
        let centre = moments.centre * units.length;
        let masses = body.nodes.iter().map(|v| model.masses[*v as usize]);
        let masses: Vec<f64> = masses.collect();
        let rest = body.nodes.iter().map(|v| model.rest_positions[*v as usize]);
        let arms: Vec<DVec3> = rest.map(|x| x - centre).collect();
        let own = |v: u32| body.nodes.binary_search(&v).ok().map(|k| k as u32);
        let faces = boundary.iter().filter_map(|f| {
            let [a, b, c] = *f;
            Some([own(a)?, own(b)?, own(c)?])
        });
        let shares = body.nodes.iter().zip(&masses).map(|(v, m)| {
            let share = if soft[*v as usize] {
                RIGID_MASS_FRACTION
            } else {
                1.0
            };
            share * m
        });
        let principal = moments.principal.0.iter().sum::<f64>();
        Ok(RigidRegion {
            labels: body.labels.clone(),
            inertia: inertia(shares.collect(), &arms, scale),
            faces: faces.collect(),
            is_isolated: !body.nodes.iter().any(|v| soft[*v as usize]),
            radius: (principal / moments.mass).sqrt() * units.length,
            nodes: body.nodes.clone(),
            masses,
            lever_arms: arms,
            centre,
        })
    }

    /// Fraction of the mass of a shared node that belongs to the particle.
    pub const PARTICLE: f64 = 1.0 - RIGID_MASS_FRACTION;

    /// Fits the pose (position of the centre in m, and rotation) that maps the nodes `of` (local
    /// numbers) closest to `places` (m), starting from the rotation `near`.
    fn fit_pose(&self, of: &[usize], places: &[DVec3], near: DQuat) -> (DVec3, DQuat) {
        let weight: f64 = of.iter().map(|k| self.masses[*k]).sum();
        let each = || of.iter().zip(places);
        let middle = each().map(|(k, x)| self.masses[*k] * *x).sum::<DVec3>() / weight;
        let arm = of.iter().map(|k| self.masses[*k] * self.lever_arms[*k]);
        let arm = arm.sum::<DVec3>() / weight;
        let mut m = DMat3::ZERO;
        for (k, x) in each() {
            let (a, b) = (self.masses[*k] * (*x - middle), self.lever_arms[*k] - arm);
            m += DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        }
        let turn = closest_rotation(&m, near, DMat3::IDENTITY);
        (middle - turn * arm, turn)
    }

    /// The collider of its boundary; `None` if it has no faces.
    ///
    /// # Errors
    /// [`Error::Input`] if rapier rejects the surface.
    fn collider(&self, scale: Scale) -> Result<Option<ColliderBuilder>> {
        if self.faces.is_empty() {
            return Ok(None);
        }
        let vertices: Vec<Vector> = self.lever_arms.iter().map(|r| scale.vector(*r)).collect();
        let mut used = vec![u32::MAX; vertices.len()];
        let mut points = Vec::new();
        let mut faces = self.faces.clone();
        for v in faces.iter_mut().flatten() {
            let number = &mut used[*v as usize];
            if *number == u32::MAX {
                *number = points.len() as u32;
                points.push(vertices[*v as usize]);
            }
            *v = *number;
        }
        let six = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| points[*v as usize]);
            a.dot(b.cross(c))
        };
        let volume = faces.iter().map(six).sum::<f32>() / 6.0;
        if self.is_isolated
            && let Some(hull) = SharedShape::convex_hull(&points)
            && hull.mass_properties(1.0).mass() <= CONVEX_VOLUME_RATIO * volume
        {
            return Ok(Some(ColliderBuilder::new(hull)));
        }
        let flags = match self.is_isolated {
            true => TriMeshFlags::FIX_INTERNAL_EDGES | TriMeshFlags::ORIENTED,
            false => TriMeshFlags::FIX_INTERNAL_EDGES,
        };
        let mesh = ColliderBuilder::trimesh_with_flags(points, faces, flags);
        mesh.map(Some).map_err(|e| {
            Error::Input(format!(
                "rapier cannot build a mesh from the surface of a rigid region: {e}; use --engine cpu"
            ))
        })
    }
}

/// Mass properties of point masses `masses` (kg) at `arms` (m).
fn inertia(masses: Vec<f64>, arms: &[DVec3], scale: Scale) -> MassProperties {
    let each = || masses.iter().zip(arms);
    let mass: f64 = masses.iter().sum();
    let middle = each().map(|(m, r)| *m * *r).sum::<DVec3>() / mass;
    let mut second = DMat3::ZERO;
    for (m, r) in each() {
        let r = *r - middle;
        let square = DMat3::from_diagonal(DVec3::splat(r.length_squared()));
        second += (square - DMat3::from_cols(r * r.x, r * r.y, r * r.z)) * *m;
    }
    let unit = scale.mass * scale.length * scale.length;
    let column = |c: DVec3| {
        let [x, y, z] = (c / unit).as_vec3().to_array();
        Vector::new(x, y, z)
    };
    let columns = [second.x_axis, second.y_axis, second.z_axis].map(column);
    MassProperties::with_inertia_matrix(
        scale.vector(middle),
        (mass / scale.mass) as f32,
        Matrix::from_cols(columns[0], columns[1], columns[2]),
    )
}

/// A rigid region in a world, and its constraints.
pub(super) struct RigidRegionBody {
    pub handle: RigidBodyHandle,
    /// Constrained nodes, in local numbers, and their targets, m.
    held: BTreeMap<usize, DVec3>,
    /// Kinematic bodies to which some of these nodes are joined.
    anchors: Vec<(usize, RigidBodyHandle)>,
}

impl RigidRegionBody {
    /// Inserts `bone` at rest with the given damping; with a collider of the given skin thickness
    /// if `friction` is given.
    ///
    /// # Errors
    /// As [`RigidRegion::collider`].
    pub fn new(
        physics: &mut PhysicsWorld,
        bone: &RigidRegion,
        scale: Scale,
        contact: Option<(f64, f32)>,
        damping: f32,
    ) -> Result<RigidRegionBody> {
        let body = RigidBodyBuilder::dynamic()
            .translation(scale.vector(bone.centre))
            .additional_mass_properties(bone.inertia)
            .gyroscopic_forces_enabled(true)
            .linear_damping(damping)
            .angular_damping(damping)
            .can_sleep(false);
        let handle = physics.insert_body(body);
        if let Some((friction, skin)) = contact
            && let Some(collider) = bone.collider(scale)?
        {
            let groups = match bone.is_isolated {
                true => InteractionGroups::default(),
                false => InteractionGroups::new(
                    HELD_BY_SOFT,
                    Group::ALL.difference(SOFT_GROUP),
                    InteractionTestMode::And,
                ),
            };
            let collider = collider
                .density(0.0)
                .friction(friction as f32)
                .contact_skin(skin)
                .collision_groups(groups);
            physics.insert_collider(collider, Some(handle));
        }
        Ok(RigidRegionBody {
            handle,
            held: BTreeMap::new(),
            anchors: Vec::new(),
        })
    }

    /// Returns the position of its centre, m, and its rotation.
    pub fn pose(&self, physics: &PhysicsWorld, scale: Scale) -> (DVec3, DQuat) {
        let pose = physics.bodies[self.handle].position();
        let [x, y, z, w] = pose.rotation.to_array().map(f64::from);
        let turn = DQuat::from_xyzw(x, y, z, w).normalize();
        (scale.metres(pose.translation), turn)
    }

    /// Returns the velocity at `point` (m), m/s.
    pub fn velocity(&self, physics: &PhysicsWorld, point: DVec3, scale: Scale) -> DVec3 {
        let body = &physics.bodies[self.handle];
        scale.metres(body.velocity_at_point(scale.vector(point)))
    }

    /// Sets the pose and velocity that fit the positions `x` (m) and velocities `v` (m/s) of all
    /// nodes of the mesh best.
    pub fn set(
        &self,
        physics: &mut PhysicsWorld,
        bone: &RigidRegion,
        (x, v): (&[DVec3], &[DVec3]),
        scale: Scale,
    ) {
        let all: Vec<usize> = (0..bone.nodes.len()).collect();
        let places: Vec<DVec3> = bone.nodes.iter().map(|i| x[*i as usize]).collect();
        let near = self.pose(physics, scale).1;
        let (centre, turn) = bone.fit_pose(&all, &places, near);
        let mass: f64 = bone.masses.iter().sum();
        let (mut mean, mut spin, mut inertia) = (DVec3::ZERO, DVec3::ZERO, DMat3::ZERO);
        for ((i, m), r) in bone.nodes.iter().zip(&bone.masses).zip(&bone.lever_arms) {
            let (r, v) = (turn * *r, v[*i as usize]);
            mean += *m * v / mass;
            spin += *m * r.cross(v);
            let square = DMat3::from_diagonal(DVec3::splat(r.length_squared()));
            inertia += (square - DMat3::from_cols(r * r.x, r * r.y, r * r.z)) * *m;
        }
        let spin = inertia.inverse() * spin;
        let body = &mut physics.bodies[self.handle];
        body.set_position(scale.pose(centre, turn), true);
        let [a, b, c] = bone.inertia.local_com.to_array().map(f64::from);
        let arm = turn * (scale.length * DVec3::new(a, b, c));
        body.set_linvel(scale.vector(mean + spin.cross(arm)), true);
        let [x, y, z] = spin.as_vec3().to_array();
        body.set_angvel(Vector::new(x, y, z), true);
    }

    /// Constrains the nodes `held` (mesh numbers) at their present positions `x` (m, of all nodes)
    /// and releases the others. With one held node the region rotates about a point, with two about
    /// an axis; with three it becomes kinematic.
    pub fn hold(
        &mut self,
        physics: &mut PhysicsWorld,
        bone: &RigidRegion,
        held: &[bool],
        x: &[DVec3],
        scale: Scale,
    ) {
        let nodes = bone.nodes.iter().enumerate();
        let wanted = nodes.filter(|(_, v)| held[**v as usize]);
        let wanted: BTreeMap<usize, DVec3> = wanted.map(|(k, v)| (k, x[*v as usize])).collect();
        if wanted.keys().eq(self.held.keys()) {
            return;
        }
        for (_, anchor) in self.anchors.drain(..) {
            physics.remove_body(anchor);
        }
        self.held = wanted;
        let freedom =
            DegreesOfFreedom::of(self.held.keys().map(|k| bone.lever_arms[*k]), bone.radius);
        let kind = match freedom {
            DegreesOfFreedom::Fixed => RigidBodyType::KinematicPositionBased,
            _ => RigidBodyType::Dynamic,
        };
        physics.bodies[self.handle].set_body_type(kind, true);
        let joined: Vec<usize> = match (freedom, self.held.keys().next()) {
            (DegreesOfFreedom::Rotational(at, axis), Some(first)) => {
                let far = |k: &&usize| bone.lever_arms[**k].distance(at);
                let last = self.held.keys().max_by(|a, b| far(a).total_cmp(&far(b)));
                let last = last.filter(|_| axis.is_some()).copied();
                std::iter::once(*first).chain(last).collect()
            }
            _ => Vec::new(),
        };
        for k in joined {
            let at = RigidBodyBuilder::kinematic_position_based();
            let at = at.translation(scale.vector(self.held[&k]));
            let anchor = physics.insert_body(at);
            let joint =
                SphericalJointBuilder::new().local_anchor2(scale.vector(bone.lever_arms[k]));
            physics.insert_impulse_joint(anchor, self.handle, joint);
            self.anchors.push((k, anchor));
        }
    }

    /// Sets the target `place` (m) of the mesh node `node` for the next step, if it is constrained
    /// here.
    pub fn set_node_target(&mut self, bone: &RigidRegion, node: u32, place: DVec3) {
        let own = bone.nodes.binary_search(&node).ok();
        if let Some(held) = own.and_then(|k| self.held.get_mut(&k)) {
            *held = place;
        }
    }

    /// Applies the targets of its constrained nodes in the next step.
    pub fn apply_targets(&self, physics: &mut PhysicsWorld, bone: &RigidRegion, scale: Scale) {
        for (k, anchor) in &self.anchors {
            let to = scale.vector(self.held[k]);
            physics.bodies[*anchor].set_next_kinematic_translation(to);
        }
        if physics.bodies[self.handle].body_type() == RigidBodyType::KinematicPositionBased {
            let of: Vec<usize> = self.held.keys().copied().collect();
            let places: Vec<DVec3> = self.held.values().copied().collect();
            let near = self.pose(physics, scale).1;
            let (centre, turn) = bone.fit_pose(&of, &places, near);
            let body = &mut physics.bodies[self.handle];
            body.set_next_kinematic_position(scale.pose(centre, turn));
        }
    }

    /// Applies the forces (N, of all nodes) at the present positions of its nodes.
    pub fn apply_forces(
        &self,
        physics: &mut PhysicsWorld,
        bone: &RigidRegion,
        forces: &[DVec3],
        scale: Scale,
    ) {
        let (centre, turn) = self.pose(physics, scale);
        let body = &mut physics.bodies[self.handle];
        body.reset_forces(true);
        body.reset_torques(true);
        for (v, arm) in bone.nodes.iter().zip(&bone.lever_arms) {
            let force = forces[*v as usize];
            if force != DVec3::ZERO {
                let at = scale.vector(centre + turn * *arm);
                body.add_force_at_point(scale.force(force), at, true);
            }
        }
    }
}
