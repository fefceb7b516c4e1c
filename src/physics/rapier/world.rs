//! A world of rapier with one soft body in it, and the tools that press on that.

use super::matter::Matter;
use super::shape::collider;
use super::springs::{Hung, Spring};
use crate::physics::{ConjugateGradients, SelfContact, Tool, ToolPose};
use crate::{Error, Result};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{
    CoefficientCombineRule, ColliderBuilder, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle,
    SoftBody, SoftBodyBuilder, SoftBodyHandle, SoftBodySolver,
};

/// Substeps of a step, each an implicit Euler step: rapier's own default.
const SUBSTEPS: usize = 4;

/// Residual of the linear solves, of the right side, where nothing is said: rapier's own default.
const RESIDUAL: f64 = 1e-5;

/// What rapier takes for a metre, in units: its tolerances are meant for cells of about a tenth.
const METRE: f32 = 8.0;

/// The skin around the boundary, where no gap is given, in units: mean edges.
const SKIN: f64 = 0.02;

/// Degrees of freedom up to which a body that touches something has its matrix factorized, once a
/// step: every contact costs a solve with it.
const FACTORIZED: usize = 9000;

/// What a body touches, and how.
#[derive(Clone, Debug, Default)]
pub(super) struct Contacts {
    /// In file units.
    pub tools: Vec<Tool>,
    /// In file units.
    pub itself: Option<SelfContact>,
    /// Metres in a file unit.
    pub unit: f64,
}

impl Contacts {
    /// Whether there are any.
    pub fn any(&self) -> bool {
        self.itself.is_some() || !self.tools.is_empty()
    }

    /// Refuses what rapier cannot tell apart.
    ///
    /// # Errors
    /// [`Error::Input`] for a tool that is smoother than the body is to itself, or nearer.
    pub fn check(&self) -> Result<()> {
        let Some(own) = self.itself else {
            return Ok(());
        };
        let refused = |what: &str, has: f64, least: f64| {
            Err(Error::Input(format!(
                "in rapier a tool's {what} is at least {least} beside such a [contact], and one has {has}; give it as much, or take --engine cpu"
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

    /// The thickness of the body's skin, in units of `length` metres: parts of it push each other
    /// from twice that on, tools from that and their own.
    fn skin(&self, length: f64) -> f64 {
        let local = |gap: f64| gap * self.unit / length;
        if let Some(gap) = self.itself.and_then(|c| c.gap) {
            return local(0.5 * gap);
        }
        let gaps = self.tools.iter().filter_map(|t| t.gap);
        gaps.map(local).fold(SKIN, f64::min)
    }
}

/// The world of one body.
pub(super) struct World {
    physics: PhysicsWorld,
    body: SoftBodyHandle,
    tools: Vec<RigidBodyHandle>,
    springs: Vec<Hung>,
}

impl World {
    /// The body of `matter` at rest, and its tools at `places` (m).
    ///
    /// # Errors
    /// [`Error::Input`] for a tool whose surface rapier refuses.
    pub fn new(
        matter: &Matter,
        settings: ConjugateGradients,
        contacts: &Contacts,
        places: &[ToolPose],
    ) -> Result<World> {
        let mut physics = PhysicsWorld::new();
        let parameters = &mut physics.integration_parameters;
        parameters.num_solver_iterations = SUBSTEPS;
        parameters.length_unit = METRE;
        parameters.normalized_max_linear_velocity = f32::MAX / METRE;
        // Contacts of what hardly moves are found anew too: the body changes its shape.
        parameters.contact_recycling = false;
        let fem = &mut parameters.soft_bodies.fem;
        let wanted = ConjugateGradients::default();
        fem.linear_tolerance = match settings.tolerance == wanted.tolerance {
            true => RESIDUAL as f32,
            false => settings.tolerance as f32,
        };
        fem.max_linear_iterations = settings.max_iterations as usize;
        fem.max_dense_dofs = match contacts.any() {
            true => FACTORIZED,
            false => 0,
        };
        let body = physics.insert_soft_body(builder(matter, contacts));
        stiffen(&mut physics, body, matter);
        let mut tools = Vec::new();
        for (tool, place) in contacts.tools.iter().zip(places) {
            let scale = matter.scale;
            let gap = tool
                .gap
                .map_or(0.0, |gap| gap * contacts.unit / scale.length);
            let shape = collider(&tool.shape.scaled(contacts.unit / scale.length))?
                .friction(tool.friction as f32)
                .friction_combine_rule(CoefficientCombineRule::Max)
                .contact_skin((gap - contacts.skin(scale.length)).max(0.0) as f32);
            let rigid = RigidBodyBuilder::kinematic_position_based()
                .pose(scale.pose(place.place(), place.turn()));
            tools.push(physics.insert(rigid, shape).0);
        }
        Ok(World {
            physics,
            body,
            tools,
            springs: Vec::new(),
        })
    }

    /// Adds a spring to a target.
    pub fn add_spring(&mut self, spring: &Spring, matter: &Matter) {
        let hung = Hung::new(&mut self.physics, self.body, spring, matter.scale);
        self.springs.extend(hung);
    }

    /// Has the springs, in the order in which they were added, pull to `targets` (m) in the next
    /// step.
    pub fn aim_springs(&mut self, targets: impl Iterator<Item = DVec3>, matter: &Matter) {
        for (hung, target) in self.springs.iter().zip(targets) {
            hung.aim(&mut self.physics, self.body, target, matter.scale);
        }
    }

    /// The soft body.
    pub fn body(&self) -> &SoftBody {
        &self.physics.soft_bodies[self.body]
    }

    /// As [`World::body`], to change it.
    pub fn body_mut(&mut self) -> &mut SoftBody {
        &mut self.physics.soft_bodies[self.body]
    }

    /// Sets gravity.
    pub fn set_gravity(&mut self, gravity: Vector) {
        self.physics.gravity = gravity;
    }

    /// Has a tool go to `place` (m) with the next step, or puts it there at once.
    pub fn guide(&mut self, tool: usize, place: &ToolPose, matter: &Matter, at_once: bool) {
        let pose = matter.scale.pose(place.place(), place.turn());
        let Some(rigid) = self.tools.get(tool) else {
            return;
        };
        let rigid = &mut self.physics.bodies[*rigid];
        match at_once {
            true => rigid.set_position(pose, true),
            false => rigid.set_next_kinematic_position(pose),
        }
    }

    /// A step of `dt` seconds; whether the body stayed sound.
    pub fn step(&mut self, dt: f64) -> bool {
        self.physics.integration_parameters.dt = dt as f32;
        self.physics.step();
        let body = self.body();
        let mut particles = body.particles().iter();
        body.is_enabled() && particles.all(|p| p.position().is_finite() && p.velocity().is_finite())
    }

    /// Positions, m.
    pub fn positions(&self, matter: &Matter) -> Vec<DVec3> {
        let all = self.body().particle_positions();
        all.map(|x| matter.scale.metres(x)).collect()
    }

    /// Velocities, m/s.
    pub fn velocities(&self, matter: &Matter) -> Vec<DVec3> {
        let all = self.body().particle_velocities();
        all.map(|v| matter.scale.metres(v)).collect()
    }
}

/// The soft body of `matter`.
fn builder(matter: &Matter, contacts: &Contacts) -> SoftBodyBuilder {
    let skin = contacts.skin(matter.scale.length) as f32;
    let body = SoftBodyBuilder::new(matter.rest.clone())
        .cells(matter.cells.clone())
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
    let own = contacts.itself.map_or(0.0, |c| c.friction);
    let surface = ColliderBuilder::ball(skin)
        .density(0.0)
        .friction(own as f32);
    body.surface_collider(surface)
        .self_contacts(contacts.itself.is_some())
}

/// Makes groups of tets as stiff as they are. What rapier can name is all tets between some nodes:
/// those that are named so and are of another group are set right by themselves.
fn stiffen(physics: &mut PhysicsWorld, body: SoftBodyHandle, matter: &Matter) {
    let mut wanted = vec![1.0f32; matter.cells.len()];
    for (cells, factor) in &matter.groups {
        cells.iter().for_each(|c| wanted[*c as usize] = *factor);
        let corners = cells.iter().flat_map(|c| matter.cells[*c as usize]);
        set_stiffness(physics, body, corners.collect(), *factor);
    }
    let found =
        |physics: &PhysicsWorld, c: usize| physics.soft_bodies[body].cells()[c].stiffness_scale;
    for (c, factor) in wanted.iter().enumerate() {
        if found(physics, c) != *factor {
            set_stiffness(physics, body, matter.cells[c].to_vec(), *factor);
        }
    }
}

fn set_stiffness(physics: &mut PhysicsWorld, body: SoftBodyHandle, nodes: Vec<u32>, factor: f32) {
    if let Some(cluster) = physics.add_soft_body_cluster(body, &nodes) {
        physics.soft_bodies[body].set_cluster_stiffness_scale(cluster, factor);
        physics.remove_soft_body_cluster(body, cluster);
    }
}
