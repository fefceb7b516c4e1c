//! The body that the rapier worker steps: loads, steps and state.

use super::internal_forces::internal_forces;
use super::joints::RegionJoint;
use super::soft_body_model::SoftBodyModel;
use super::target_springs::TargetSpring;
use super::world::{Contacts, World};
use crate::physics::cpu::{
    LoadUpdate, NodeConstraint, StepFailure, Steppable, ToolTarget, check_attachments,
};
use crate::physics::loads::force_balance::ForceSums;
use crate::physics::{
    CgSettings, DiscreteModel, ForceBalance, Joint, Reaction, SelfContactSettings, StepRecord,
    Tool, ToolPose,
};
use crate::{Error, Result};
use glam::DVec3;

/// Search radius of tool forces, in mean edge lengths beyond the gap. Nodes within it may share in
/// a contact, because faces touch where they have no nodes.
const TOOL_SEARCH_RADIUS: f64 = 1.5;

/// A tetrahedral body in its own rapier world.
pub(in crate::physics) struct RapierBody {
    matter: SoftBodyModel,
    settings: CgSettings,
    contacts: Contacts,
    joints: Vec<RegionJoint>,
    world: World,
    /// Nodal masses, kg.
    masses: Vec<f64>,
    gravity: DVec3,
    forces: Vec<DVec3>,
    pinned: Vec<bool>,
    attachments: Vec<NodeConstraint>,
    /// Tool poses or targets, m, and how often each tool was teleported.
    tools: Vec<ToolTarget>,
    steps: u64,
    /// Length of the last step, s, and the velocities before it, m/s.
    last: Option<(f64, Vec<DVec3>)>,
}

impl RapierBody {
    /// The body of `matter` at rest, with nodal `masses` (kg); a file unit is `unit` metres.
    ///
    /// # Errors
    /// Only errors of rapier.
    pub(super) fn new(
        matter: SoftBodyModel,
        masses: Vec<f64>,
        settings: CgSettings,
        unit: f64,
    ) -> Result<RapierBody> {
        let contacts = Contacts {
            unit,
            ..Contacts::default()
        };
        let nodes = masses.len();
        Ok(RapierBody {
            world: World::new(&matter, settings, (&contacts, &[]), &[])?,
            matter,
            settings,
            contacts,
            joints: Vec::new(),
            masses,
            gravity: DVec3::ZERO,
            forces: vec![DVec3::ZERO; nodes],
            pinned: vec![false; nodes],
            attachments: Vec::new(),
            tools: Vec::new(),
            steps: 0,
            last: None,
        })
    }

    /// Sets the tolerances of the linear solves.
    ///
    /// # Errors
    /// As [`RapierBody::add_tool`].
    pub fn set_settings(&mut self, settings: CgSettings) -> Result<()> {
        self.settings = settings;
        self.rebuild_world(&self.positions(), &self.velocities())
    }

    /// Adds a tool with this `pose` (m).
    ///
    /// # Errors
    /// [`Error::Input`] if rapier does not support the tool; nothing is changed then.
    pub fn add_tool(&mut self, tool: &Tool, pose: ToolPose) -> Result<()> {
        let before = self.contacts.clone();
        self.contacts.tools.push(tool.clone());
        self.tools.push((pose, 0));
        let done = self.contact(before);
        if done.is_err() {
            self.tools.pop();
        }
        done
    }

    /// Enables self-contact.
    ///
    /// # Errors
    /// [`Error::Input`] if rapier does not support the settings; nothing is changed then.
    pub fn set_self_contact(&mut self, wanted: SelfContactSettings) -> Result<()> {
        let before = self.contacts.clone();
        self.contacts.self_contact = Some(wanted);
        self.contact(before)
    }

    /// Adds `joint` between rigid regions, located at `at` (m).
    ///
    /// # Errors
    /// [`Error::Input`] if the regions are not rigid; nothing is changed then.
    pub fn add_joint(&mut self, joint: &Joint, at: DVec3) -> Result<()> {
        let joined = RegionJoint::new(joint, at, &self.matter.bones, self.contacts.unit)?;
        self.joints.push(joined);
        self.rebuild_world(&self.positions(), &self.velocities())
    }

    /// Returns the force and moment that the rest of the body exerted on the rigid region with this
    /// label in the last step, by contact, joints and the soft tissue around it; the moment is
    /// about its centre of mass. `None` if there is no such region.
    pub fn region_force(&self, label: i64) -> Option<Reaction> {
        let mut bones = self.matter.bones.iter().enumerate();
        let (b, bone) = bones.find(|(_, bone)| bone.labels.contains(&label))?;
        let (x, v) = (self.positions(), self.velocities());
        let mass: f64 = bone.masses.iter().sum();
        let each = || bone.nodes.iter().map(|i| *i as usize).zip(&bone.masses);
        let centre = each().map(|(i, m)| *m * x[i]).sum::<DVec3>() / mass;
        let mut on = Reaction::default();
        let mut add = |i: usize, force: DVec3| {
            on.force += force;
            on.moment += (x[i] - centre).cross(force);
        };
        for (i, m) in each() {
            let change = match &self.last {
                Some((dt, before)) => (v[i] - before[i]) / *dt,
                None => DVec3::ZERO,
            };
            let damping = f64::from(self.matter.mass_damping) * v[i];
            add(i, *m * (change + damping - self.gravity) - self.forces[i]);
        }
        for spring in TargetSpring::of(&self.attachments) {
            let i = spring.node as usize;
            if self.matter.owners[i] == Some(b as u32) {
                let pull = spring.stiffness * (spring.target - x[i]);
                add(i, -pull.clamp_length_max(spring.limit));
            }
        }
        Some(on)
    }

    /// Rebuilds the world with the present contacts; on failure restores the contacts `before`.
    fn contact(&mut self, before: Contacts) -> Result<()> {
        let (x, v) = (self.positions(), self.velocities());
        let done = self
            .contacts
            .check()
            .and_then(|()| self.rebuild_world(&x, &v));
        if done.is_err() {
            self.contacts = before;
        }
        done
    }

    /// Rebuilds the world with the nodes at `x` (m) and velocities `v` (m/s). rapier's warm-start
    /// data of previous steps would not fit a state that it did not compute.
    fn rebuild_world(&mut self, x: &[DVec3], v: &[DVec3]) -> Result<()> {
        let places: Vec<ToolPose> = self.tools.iter().map(|t| t.0).collect();
        let scenery = (&self.contacts, self.joints.as_slice());
        let mut world = World::new(&self.matter, self.settings, scenery, &places)?;
        let scale = self.matter.scale;
        world.set(x, v, &self.matter);
        world.set_gravity(scale.vector(self.gravity));
        for spring in TargetSpring::of(&self.attachments) {
            world.add_spring(&spring, &self.matter);
        }
        self.world = world;
        self.last = None;
        self.apply_pins();
        self.world.apply_forces(&self.forces, &self.matter);
        Ok(())
    }

    /// Whether each node is constrained.
    fn held(&self) -> Vec<bool> {
        let mut held = self.pinned.clone();
        for a in &self.attachments {
            if let NodeConstraint::Fixed { node, .. } | NodeConstraint::Prescribed { node, .. } = a
            {
                held[*node as usize] = true;
            }
        }
        held
    }

    /// Fixes constrained nodes at their present positions and releases the others.
    fn apply_pins(&mut self) {
        self.world.hold(&self.held(), &self.matter);
    }

    /// Sets the targets of held and prescribed nodes at the end of a step of `dt` seconds.
    fn set_constraint_targets(&mut self, dt: f64) {
        let targets = TargetSpring::of(&self.attachments).map(|s| s.target);
        self.world.aim_springs(targets, &self.matter);
        for a in &mut self.attachments {
            match a {
                NodeConstraint::Fixed { node, place } => {
                    self.world.set_node_target(*node, *place, &self.matter);
                }
                NodeConstraint::Prescribed {
                    node,
                    place,
                    velocity,
                } => {
                    *place += dt * *velocity;
                    self.world.set_node_target(*node, *place, &self.matter);
                }
                NodeConstraint::Spring { .. } => {}
            }
        }
    }

    /// Returns the force on every node, N, from the tets of `model` (the model of this body),
    /// damping and loads; NaN for nodes of rigid regions.
    pub fn forces(&self, model: &DiscreteModel) -> Vec<DVec3> {
        let mut forces = internal_forces(model, &self.positions(), &self.velocities());
        let loads = self.masses.iter().zip(&self.forces);
        for (f, (m, load)) in forces.iter_mut().zip(loads) {
            *f += *m * self.gravity + *load;
        }
        // The internal forces of rigid regions are unknown.
        for node in self.matter.bones.iter().flat_map(|bone| &bone.nodes) {
            forces[*node as usize] = DVec3::NAN;
        }
        forces
    }

    /// Returns the balance of the static forces; `None` with tools or rigid regions, whose contact
    /// forces are unknown.
    pub fn force_balance(&self, model: &DiscreteModel) -> Option<ForceBalance> {
        if !self.tools.is_empty() || !self.matter.bones.is_empty() {
            return None;
        }
        let x = self.positions();
        let internal = internal_forces(model, &x, &vec![DVec3::ZERO; x.len()]);
        let resolution = 0.5 * f64::from(f32::EPSILON) * model.frame.scale * model.length_unit;
        let (stiffness, held) = (model.nodal_stiffness(), self.held());
        let mut sums = ForceSums::default();
        for (v, own) in internal.into_iter().enumerate() {
            let load = self.masses[v] * self.gravity + self.forces[v];
            sums.add(own, load, !held[v], resolution * stiffness[v]);
        }
        Some(sums.balance())
    }

    /// Returns the reaction on each tool: the residual of the equations of motion over the last
    /// step, summed over the nodes of `boundary` near the tool.
    pub fn tool_forces(
        &self,
        model: &DiscreteModel,
        boundary: impl IntoIterator<Item = u32>,
    ) -> Vec<Reaction> {
        let (x, v) = (self.positions(), self.velocities());
        let (forces, held) = (self.forces(model), self.held());
        let mut reactions = vec![Reaction::default(); self.tools.len()];
        let nodes = boundary.into_iter().map(|i| i as usize);
        let free = nodes.filter(|i| !held[*i] && self.matter.owners[*i].is_none());
        for i in free {
            let Some((tool, place)) = self.nearest_tool(x[i]) else {
                continue;
            };
            let change = match &self.last {
                Some((dt, before)) => (v[i] - before[i]) / *dt,
                None => DVec3::ZERO,
            };
            let pushed = forces[i] - self.masses[i] * change;
            reactions[tool].force += pushed;
            reactions[tool].moment += (x[i] - place).cross(pushed);
        }
        reactions
    }

    /// Returns the nearest tool to a node at `x` (m) within the search radius, and the closest
    /// point.
    fn nearest_tool(&self, x: DVec3) -> Option<(usize, DVec3)> {
        let reach = TOOL_SEARCH_RADIUS * self.matter.scale.length;
        let near = self.tools.iter().zip(&self.contacts.tools).enumerate();
        near.map(|(k, ((pose, _), tool))| {
            let shape = tool.shape.with_scale(self.contacts.unit);
            let at = pose.rotation().inverse() * (x - pose.position());
            let gap = tool.gap.unwrap_or(0.0) * self.contacts.unit;
            (shape.distance(at) - gap, k, pose.position())
        })
        .filter(|(distance, ..)| *distance < reach)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k, place)| (k, place))
    }

    fn kinetic_energy(&self, velocities: &[DVec3]) -> f64 {
        let each = self.masses.iter().zip(velocities);
        0.5 * each.map(|(m, v)| m * v.length_squared()).sum::<f64>()
    }
}

impl Steppable for RapierBody {
    fn has_long_steps(&self) -> bool {
        false
    }

    fn run(&mut self, steps: u32, dt: f64) -> std::result::Result<StepRecord, StepFailure> {
        if !(dt as f32 > 0.0 && (dt as f32).is_finite()) {
            return Err(StepFailure::BadStep { h: dt });
        }
        let mut record = StepRecord::default();
        for _ in 0..steps {
            let (x, v) = (self.positions(), self.velocities());
            self.set_constraint_targets(dt);
            if !self.world.step(dt, &self.forces, &self.matter) {
                // Restores the state before the step.
                let _ = self.rebuild_world(&x, &v);
                return Err(StepFailure::NonFinite);
            }
            self.steps += 1;
            record.kinetic = self.kinetic_energy(&self.velocities());
            self.last = Some((dt, v));
        }
        Ok(record)
    }

    fn steps(&self) -> u64 {
        self.steps
    }

    fn positions(&self) -> Vec<DVec3> {
        self.world.positions(&self.matter)
    }

    fn velocities(&self) -> Vec<DVec3> {
        self.world.velocities(&self.matter)
    }

    fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        let nodes = self.masses.len();
        let finite = positions.iter().chain(velocities).all(|v| v.is_finite());
        if [positions.len(), velocities.len()] != [nodes; 2] || !finite {
            return Err(Error::Input(format!(
                "got {} positions and {} velocities for {nodes} nodes; give a finite one of each per node",
                positions.len(),
                velocities.len()
            )));
        }
        self.rebuild_world(positions, velocities)
    }

    fn apply_loads(&mut self, change: LoadUpdate) -> Result<()> {
        self.gravity = change.gravity;
        let gravity = self.matter.scale.vector(change.gravity);
        self.world.set_gravity(gravity);
        if let Some(pinned) = change.pinned {
            self.pinned = pinned;
        }
        if let Some(attachments) = change.attachments {
            check_attachments(&attachments, self.masses.len())?;
            let known: Vec<TargetSpring> = TargetSpring::of(&self.attachments).collect();
            let wanted: Vec<TargetSpring> = TargetSpring::of(&attachments).collect();
            let mut pairs = known.iter().zip(&wanted);
            let same = known.len() == wanted.len() && pairs.all(|(a, b)| a.same_parameters(b));
            self.attachments = attachments;
            if !same {
                self.rebuild_world(&self.positions(), &self.velocities())?;
            }
        }
        self.apply_pins();
        if let Some(forces) = change.forces {
            self.forces = forces;
            self.world.apply_forces(&self.forces, &self.matter);
        }
        for (k, tool) in change.tools.into_iter().flatten().enumerate() {
            let jumped = self.tools.get(k).is_some_and(|t| t.1 != tool.1);
            self.world.set_tool_target(k, &tool.0, &self.matter, jumped);
            if let Some(own) = self.tools.get_mut(k) {
                *own = tool;
            }
        }
        Ok(())
    }
}
