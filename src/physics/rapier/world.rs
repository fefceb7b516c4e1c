//! A rapier world with one soft body, its rigid regions, and the tools.

use super::collider::collider;
use super::joints::RegionJoint;
use super::rigid_region::RigidRegionBody;
use super::soft_body_model::SoftBodyModel;
use super::target_springs::{AttachedSpring, SpringAnchor, TargetSpring};
use crate::physics::{CgSettings, SelfContactSettings, Tool, ToolPose};
use crate::{Error, Result};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{
    CoefficientCombineRule, ColliderBuilder, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle,
    SoftBody, SoftBodyBuilder, SoftBodyHandle, SoftBodySolver,
};

/// Substeps per step, each an implicit Euler step: rapier's default.
const SUBSTEPS: usize = 4;

/// Default relative residual of the linear solves: rapier's default.
const DEFAULT_TOLERANCE: f64 = 1e-5;

/// rapier's `length_unit`, in units: its tolerances are tuned for cells of about a tenth.
const LENGTH_UNIT: f32 = 8.0;

/// Skin thickness around the boundary if no smaller gap is given, in units (mean edge lengths).
const COLLIDER_MARGIN: f64 = 0.02;

/// Number of degrees of freedom up to which the matrix of a body in contact is factorized once per
/// step, because every contact costs a solve.
const DIRECT_SOLVE_MAX_DOF: usize = 9000;

/// Tools and self-contact settings of a body.
#[derive(Clone, Debug, Default)]
pub(super) struct Contacts {
    /// In file units.
    pub tools: Vec<Tool>,
    /// In file units.
    pub self_contact: Option<SelfContactSettings>,
    /// Metres per file unit.
    pub unit: f64,
}

impl Contacts {
    /// Whether there are tools or self-contact.
    pub fn any(&self) -> bool {
        self.self_contact.is_some() || !self.tools.is_empty()
    }

    /// Rejects settings that rapier cannot represent.
    ///
    /// # Errors
    /// [`Error::Input`] if a tool has less friction than the self-contact, or a gap of less
    /// than half of its gap.
    pub fn check(&self) -> Result<()> {
        let Some(own) = self.self_contact else {
            return Ok(());
        };
        let refused = |what: &str, has: f64, least: f64| {
            Err(Error::Input(format!(
                "with rapier and this [contact], tool {what} must be ≥ {least}, got {has}; increase it, or use --engine cpu"
            )))
        };
        if let Some(tool) = self.tools.iter().find(|t| t.friction < own.friction) {
            return refused("friction", tool.friction, own.friction);
        }
        let least = own.gap.map_or(0.0, |gap| 0.5 * gap);
        match self
            .tools
            .iter()
            .filter_map(|t| t.gap)
            .find(|gap| *gap < least)
        {
            Some(gap) => refused("gap", gap, least),
            None => Ok(()),
        }
    }

    /// Skin thickness of the body, in units of `length` metres. Self-contact acts from twice the
    /// skin on, tools from the sum of the body's skin and theirs.
    fn skin(&self, length: f64) -> f64 {
        let local = |gap: f64| gap * self.unit / length;
        if let Some(gap) = self.self_contact.and_then(|c| c.gap) {
            return local(0.5 * gap);
        }
        let gaps = self.tools.iter().filter_map(|t| t.gap);
        gaps.map(local).fold(COLLIDER_MARGIN, f64::min)
    }
}

/// The world of one body.
pub(super) struct World {
    physics: PhysicsWorld,
    body: SoftBodyHandle,
    bones: Vec<RigidRegionBody>,
    tools: Vec<RigidBodyHandle>,
    springs: Vec<AttachedSpring>,
}

impl World {
    /// The body of `matter` at rest, with these joints, and its tools with the `poses` (m).
    ///
    /// # Errors
    /// [`Error::Input`] if rapier rejects the surface of a tool or a rigid region.
    pub fn new(
        matter: &SoftBodyModel,
        settings: CgSettings,
        (contacts, joints): (&Contacts, &[RegionJoint]),
        poses: &[ToolPose],
    ) -> Result<World> {
        let mut physics = PhysicsWorld::new();
        let parameters = &mut physics.integration_parameters;
        parameters.num_solver_iterations = SUBSTEPS;
        parameters.length_unit = LENGTH_UNIT;
        parameters.normalized_max_linear_velocity = f32::MAX / LENGTH_UNIT;
        // Contacts of slow bodies are recomputed too, because the body deforms.
        parameters.contact_recycling = false;
        let fem = &mut parameters.soft_bodies.fem;
        let wanted = CgSettings::default();
        fem.linear_tolerance = match settings.tolerance == wanted.tolerance {
            true => DEFAULT_TOLERANCE as f32,
            false => settings.tolerance as f32,
        };
        fem.max_linear_iterations = settings.max_iterations as usize;
        fem.max_dense_dofs = match contacts.any() {
            true => DIRECT_SOLVE_MAX_DOF,
            false => 0,
        };
        let body = physics.insert_soft_body(builder(matter, contacts));
        set_group_stiffness(&mut physics, body, matter);
        let bones = bones(&mut physics, body, matter, contacts)?;
        for joint in joints {
            joint.insert(&mut physics, &matter.bones, &bones, matter.scale);
        }
        let mut tools = Vec::new();
        for (tool, pose) in contacts.tools.iter().zip(poses) {
            let scale = matter.scale;
            let gap = tool
                .gap
                .map_or(0.0, |gap| gap * contacts.unit / scale.length);
            let shape = collider(&tool.shape.with_scale(contacts.unit / scale.length))?
                .friction(tool.friction as f32)
                .friction_combine_rule(CoefficientCombineRule::Max)
                .contact_skin((gap - contacts.skin(scale.length)).max(0.0) as f32);
            let rigid = RigidBodyBuilder::kinematic_position_based()
                .pose(scale.pose(pose.position(), pose.rotation()));
            tools.push(physics.insert(rigid, shape).0);
        }
        Ok(World {
            physics,
            body,
            bones,
            tools,
            springs: Vec::new(),
        })
    }

    /// Adds a target spring.
    pub fn add_spring(&mut self, spring: &TargetSpring, matter: &SoftBodyModel) {
        let hook = match matter.owners[spring.node as usize] {
            None => SpringAnchor::particle(&mut self.physics, self.body, matter, spring.node),
            Some(b) => {
                let (bone, own) = (&matter.bones[b as usize], &self.bones[b as usize]);
                SpringAnchor::bone(bone, own, spring.node, matter.scale)
            }
        };
        let hung =
            hook.map(|hook| AttachedSpring::new(&mut self.physics, hook, spring, matter.scale));
        self.springs.extend(hung);
    }

    /// Sets the `targets` (m) of the springs, in the order of their addition, for the next step.
    pub fn aim_springs(&mut self, targets: impl Iterator<Item = DVec3>, matter: &SoftBodyModel) {
        for (hung, target) in self.springs.iter().zip(targets) {
            hung.set_target(&mut self.physics, self.body, target, matter.scale);
        }
    }

    fn body(&self) -> &SoftBody {
        &self.physics.soft_bodies[self.body]
    }

    /// Sets the positions `x` (m) and velocities `v` (m/s) of all nodes; rigid regions take the
    /// best-fitting pose.
    pub fn set(&mut self, x: &[DVec3], v: &[DVec3], matter: &SoftBodyModel) {
        let (scale, body) = (matter.scale, &mut self.physics.soft_bodies[self.body]);
        for (p, node) in matter.nodes.iter().enumerate() {
            body.set_particle_position(p, scale.vector(x[*node as usize]));
            body.set_particle_velocity(p, scale.vector(v[*node as usize]));
        }
        for (own, bone) in self.bones.iter().zip(&matter.bones) {
            own.set(&mut self.physics, bone, (x, v), scale);
        }
    }

    /// Fixes the nodes marked in `held` at their present positions, and releases the others.
    pub fn hold(&mut self, held: &[bool], matter: &SoftBodyModel) {
        let body = &mut self.physics.soft_bodies[self.body];
        for (p, node) in matter.nodes.iter().enumerate() {
            // Rigid regions move their particles.
            let held = held[*node as usize] && matter.owners[*node as usize].is_none();
            let particle = &body.particles()[p];
            // Massless particles are always pinned in rapier.
            if particle.is_pinned() != held && particle.mass() > 0.0 {
                body.set_particle_pinned(p, held);
            }
        }
        if self.bones.is_empty() {
            return;
        }
        let x = self.positions(matter);
        for (own, bone) in self.bones.iter_mut().zip(&matter.bones) {
            own.hold(&mut self.physics, bone, held, &x, matter.scale);
        }
    }

    /// Sets the target `place` (m) of a held node for the next step.
    pub fn set_node_target(&mut self, node: u32, place: DVec3, matter: &SoftBodyModel) {
        match (
            matter.owners[node as usize],
            matter.particles[node as usize],
        ) {
            (Some(b), _) => {
                self.bones[b as usize].set_node_target(&matter.bones[b as usize], node, place)
            }
            (None, Some(p)) => {
                let body = &mut self.physics.soft_bodies[self.body];
                body.set_particle_kinematic_target(p as usize, matter.scale.vector(place));
            }
            (None, None) => {}
        }
    }

    /// Applies forces (N, of all nodes) to the particles.
    pub fn apply_forces(&mut self, forces: &[DVec3], matter: &SoftBodyModel) {
        let body = &mut self.physics.soft_bodies[self.body];
        body.reset_forces(true);
        for (p, node) in matter.nodes.iter().enumerate() {
            let force = forces[*node as usize];
            if force != DVec3::ZERO && matter.owners[*node as usize].is_none() {
                body.add_particle_force(p, matter.scale.force(force), true);
            }
        }
    }

    /// Sets gravity.
    pub fn set_gravity(&mut self, gravity: Vector) {
        self.physics.gravity = gravity;
    }

    /// Sets the target `pose` (m) of a tool for the next step, or teleports it.
    pub fn set_tool_target(
        &mut self,
        tool: usize,
        pose: &ToolPose,
        matter: &SoftBodyModel,
        at_once: bool,
    ) {
        let pose = matter.scale.pose(pose.position(), pose.rotation());
        let Some(rigid) = self.tools.get(tool) else {
            return;
        };
        let rigid = &mut self.physics.bodies[*rigid];
        match at_once {
            true => rigid.set_position(pose, true),
            false => rigid.set_next_kinematic_position(pose),
        }
    }

    /// Advances a step of `dt` seconds, with `forces` (N, of all nodes) acting on rigid regions.
    /// Returns whether the state is still valid.
    pub fn step(&mut self, dt: f64, forces: &[DVec3], matter: &SoftBodyModel) -> bool {
        for (own, bone) in self.bones.iter().zip(&matter.bones) {
            own.apply_targets(&mut self.physics, bone, matter.scale);
            own.apply_forces(&mut self.physics, bone, forces, matter.scale);
        }
        self.physics.integration_parameters.dt = dt as f32;
        self.physics.step();
        let body = self.body();
        let mut particles = body.particles().iter();
        let mut bones = self.bones.iter();
        body.is_enabled()
            && particles.all(|p| p.position().is_finite() && p.velocity().is_finite())
            && bones.all(|b| {
                self.physics.bodies[b.handle]
                    .position()
                    .translation
                    .is_finite()
            })
    }

    /// Positions of all nodes, m.
    pub fn positions(&self, matter: &SoftBodyModel) -> Vec<DVec3> {
        let scale = matter.scale;
        let mut all = vec![DVec3::ZERO; matter.particles.len()];
        for (node, x) in matter.nodes.iter().zip(self.body().particle_positions()) {
            all[*node as usize] = scale.metres(x);
        }
        for (own, bone) in self.bones.iter().zip(&matter.bones) {
            let (centre, rotation) = own.pose(&self.physics, scale);
            for (node, arm) in bone.nodes.iter().zip(&bone.lever_arms) {
                all[*node as usize] = centre + rotation * *arm;
            }
        }
        all
    }

    /// Velocities of all nodes, m/s.
    pub fn velocities(&self, matter: &SoftBodyModel) -> Vec<DVec3> {
        let scale = matter.scale;
        let mut all = vec![DVec3::ZERO; matter.particles.len()];
        for (node, v) in matter.nodes.iter().zip(self.body().particle_velocities()) {
            all[*node as usize] = scale.metres(v);
        }
        for (own, bone) in self.bones.iter().zip(&matter.bones) {
            let (centre, rotation) = own.pose(&self.physics, scale);
            for (node, arm) in bone.nodes.iter().zip(&bone.lever_arms) {
                let at = centre + rotation * *arm;
                all[*node as usize] = own.velocity(&self.physics, at, scale);
            }
        }
        all
    }
}

/// Creates the rigid regions of `matter` and attaches the particles of the soft body at rest to
/// them.
fn bones(
    physics: &mut PhysicsWorld,
    body: SoftBodyHandle,
    matter: &SoftBodyModel,
    contacts: &Contacts,
) -> Result<Vec<RigidRegionBody>> {
    let scale = matter.scale;
    let friction = contacts.self_contact.map_or(0.0, |c| c.friction);
    let skin = contacts.skin(scale.length) as f32;
    let contact = contacts.any().then_some((friction, skin));
    let mut bones = Vec::with_capacity(matter.bones.len());
    for bone in &matter.bones {
        let own = RigidRegionBody::new(physics, bone, scale, contact, matter.mass_damping)?;
        for particle in bone
            .nodes
            .iter()
            .filter_map(|v| matter.particles[*v as usize])
        {
            let soft = &mut physics.soft_bodies[body];
            soft.attach_particle(particle as usize, own.handle, &physics.bodies);
        }
        bones.push(own);
    }
    Ok(bones)
}

/// The builder of the soft body of `matter`.
fn builder(matter: &SoftBodyModel, contacts: &Contacts) -> SoftBodyBuilder {
    let skin = contacts.skin(matter.scale.length) as f32;
    let body = SoftBodyBuilder::new(matter.rest.clone())
        .cells(matter.tets.clone())
        .masses(matter.masses.clone())
        .cell_model(matter.model)
        .material(matter.material)
        .solver(SoftBodySolver::Fem)
        .linear_damping(matter.mass_damping)
        .particle_radius(skin)
        .can_sleep(false);
    if !contacts.any() {
        return body.no_surface_collider();
    }
    let own = contacts.self_contact.map_or(0.0, |c| c.friction);
    let surface = ColliderBuilder::ball(skin)
        .density(0.0)
        .friction(own as f32);
    body.surface_collider(surface)
        .self_contacts(contacts.self_contact.is_some())
}

/// Sets the stiffness of groups of tets. rapier selects all tets between given nodes; tets selected
/// that way but belonging to another group are corrected one by one.
fn set_group_stiffness(physics: &mut PhysicsWorld, body: SoftBodyHandle, matter: &SoftBodyModel) {
    let mut wanted = vec![1.0f32; matter.tets.len()];
    for (cells, factor) in &matter.groups {
        cells.iter().for_each(|c| wanted[*c as usize] = *factor);
        let corners = cells.iter().flat_map(|c| matter.tets[*c as usize]);
        set_stiffness(physics, body, corners.collect(), *factor);
    }
    let found =
        |physics: &PhysicsWorld, c: usize| physics.soft_bodies[body].cells()[c].stiffness_scale;
    for (c, factor) in wanted.iter().enumerate() {
        if found(physics, c) != *factor {
            set_stiffness(physics, body, matter.tets[c].to_vec(), *factor);
        }
    }
}

fn set_stiffness(physics: &mut PhysicsWorld, body: SoftBodyHandle, nodes: Vec<u32>, factor: f32) {
    if let Some(cluster) = physics.add_soft_body_cluster(body, &nodes) {
        physics.soft_bodies[body].set_cluster_stiffness_scale(cluster, factor);
        physics.remove_soft_body_cluster(body, cluster);
    }
}
