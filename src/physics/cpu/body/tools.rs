//! Accessors of a body's tools and self-contact.

use super::{CpuBody, ForceStatus};
#[cfg(feature = "rapier")]
use crate::physics::CgSettings;
#[cfg(feature = "rapier")]
use crate::physics::SolverKind;
use crate::physics::contact::check_pose;
use crate::physics::cpu::contact::boundary_surface::BoundarySurface;
use crate::physics::cpu::contact::parameters::{
    STATIC_FRICTION_SPEED, face_stiffnesses, self_contact_gap, tool_gap,
};
use crate::physics::cpu::contact::self_contact::SelfContactTerm;
use crate::physics::cpu::contact::tool_contact::{LocalToolPose, ToolContact, ToolState};
use crate::physics::cpu::implicit::contact_terms::{self_contact, tool_contact, tool_contact_mut};
use crate::physics::cpu::implicit::push_out::{apply_push_out, resolve_penetration};
use crate::physics::cpu::runtime::steppable::ToolTarget;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::{DiscreteModel, SelfContactSettings, Tool, ToolPose};
use crate::{Error, Result};
use glam::DVec3;
use std::any::Any;

/// Returns how many of the boundary `faces` of `network` intersect others with the nodes at `x`
/// (m).
///
/// # Errors
/// [`Error::Input`] for positions that do not match its nodes.
#[cfg(feature = "rapier")]
pub(in crate::physics) fn count_intersecting_faces(
    network: &DiscreteModel,
    faces: &[[u32; 3]],
    x: &[DVec3],
) -> Result<usize> {
    let settings = CgSettings::default();
    let mut body = CpuBody::<f32>::new(network, SolverKind::Implicit, settings, None)?;
    body.set_state(x, &vec![DVec3::ZERO; x.len()])?;
    Ok(body.set_self_contact(&SelfContactSettings::default(), faces, network))
}

impl<T: Real> CpuBody<T> {
    /// Adds a tool in contact with the boundary `faces` of `network`, the model of this body, in
    /// the network's node numbering.
    pub fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &DiscreteModel) {
        if tool_contact(&self.terms).is_none() {
            let hull = self.hull(faces, network);
            let least = STATIC_FRICTION_SPEED * self.units.time;
            let term = ToolContact::new(hull, &self.plan, least);
            self.add_term(Box::new(term));
        }
        let at = LocalToolPose {
            position: network.to_metres(tool.pose.position()) / self.units.length,
            rotation: tool.pose.rotation().normalize(),
        };
        let unit = network.length_unit / self.units.length;
        let Some(contact) = tool_contact_mut(&mut self.terms) else {
            return;
        };
        let shape = tool.shape.with_scale(unit);
        let gap = tool_gap(tool, &shape, contact.hull.edge, unit);
        contact.tools.push(ToolState {
            shape,
            from: at,
            at,
            to: at,
            friction: tool.friction,
            gap,
            teleport_count: 0,
        });
        self.invalidate(ForceStatus::Restart);
    }

    /// Enables self-contact with the settings `wanted` on the boundary `faces` of `network`, the
    /// model of this body. Returns how many of these currently intersect others, or belong to parts
    /// enclosed by others.
    pub fn set_self_contact(
        &mut self,
        wanted: &SelfContactSettings,
        faces: &[[u32; 3]],
        network: &DiscreteModel,
    ) -> usize {
        self.terms.retain(|term| {
            let term: &dyn Any = term.as_ref();
            !term.is::<SelfContactTerm<T>>()
        });
        let hull = self.hull(faces, network);
        let local = |gap: f64| gap * network.length_unit / self.units.length;
        let settings = [
            wanted.friction,
            self_contact_gap(wanted.gap.map(local), hull.edge),
            STATIC_FRICTION_SPEED * self.units.time,
        ];
        let mut term = SelfContactTerm::new(hull, &self.plan, settings);
        let through = term
            .surface
            .find_enclosed((network, &self.engine_index), &self.state.u);
        self.add_term(Box::new(term));
        through
    }

    /// Sets the pose of each tool at the end of the next step.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid poses, or a wrong number of them.
    pub fn set_tool_targets(&mut self, tools: &[ToolTarget]) -> Result<()> {
        let length = self.units.length;
        let local_pose = |pose: &ToolPose| LocalToolPose {
            position: pose.position() / length,
            rotation: pose.rotation().normalize(),
        };
        let poses: Vec<LocalToolPose> = tools
            .iter()
            .map(|(pose, _)| check_pose(pose).map(|()| local_pose(pose)))
            .collect::<Result<_>>()?;
        let count = tool_contact(&self.terms).map_or(0, |c| c.tools.len());
        if count != tools.len() {
            return Err(Error::Input(format!(
                "got target poses of {} tools, but the body has {count}",
                tools.len()
            )));
        }
        let Some(contact) = tool_contact_mut(&mut self.terms) else {
            return Ok(());
        };
        let mut jumped = false;
        for (k, (pose, (_, teleport_count))) in poses.iter().zip(tools).enumerate() {
            if contact.tools[k].teleport_count == *teleport_count {
                contact.tools[k].to = *pose;
                continue;
            }
            contact.tools[k].teleport_count = *teleport_count;
            contact.teleport(k, *pose);
            jumped = true;
        }
        self.invalidate(match jumped {
            true => ForceStatus::Restart,
            false => ForceStatus::Resume,
        });
        Ok(())
    }

    /// Returns the force of the body on each tool, N, and its moment about the origin of the tool's
    /// shape, N·m.
    pub fn tool_forces(&self) -> Vec<[DVec3; 2]> {
        let at = StateRef {
            u: &self.state.u,
            v: &self.state.v,
        };
        let units = [self.units.force(), self.units.energy()];
        let Some(contact) = tool_contact(&self.terms) else {
            return Vec::new();
        };
        let local = contact.reactions(at);
        local
            .iter()
            .map(|[f, m]| [*f * units[0], *m * units[1]])
            .collect()
    }

    /// Moves nodes inside tools out of them before a first step.
    pub(in crate::physics::cpu) fn resolve_initial_penetration(&mut self) {
        let Some(contact) = tool_contact_mut(&mut self.terms) else {
            return;
        };
        contact.begin(&self.state.u, (&self.free_mask, &self.plan), (0.0, 0.0));
        let pushed = resolve_penetration(contact, &self.state.u, &self.free_mask);
        let rigid = self.newton.as_mut().map(|n| &mut n.rigid);
        apply_push_out(pushed, &mut self.state.u, rigid);
    }

    /// Keeps the tool poses after an accepted step, or restores the previous ones.
    pub(in crate::physics::cpu) fn commit_tools(&mut self, sound: bool) {
        let own = self_contact(&self.terms).is_some_and(|own| !own.is_empty());
        let mut near = false;
        if let Some(contact) = tool_contact_mut(&mut self.terms) {
            if !sound {
                contact.set_tool_fraction(0.0);
                return;
            }
            contact.update_lagged_friction(&self.state.u);
            contact.commit_tools();
            near |= !contact.contact_points.is_empty();
        }
        match &mut self.implicit {
            Some(implicit) if own => implicit.drop_aggregate_pattern(),
            Some(implicit) if near => implicit.drop_coarse_space(),
            _ => {}
        }
    }

    /// Returns the tool poses.
    pub(in crate::physics::cpu) fn tool_places(&self) -> Vec<[f64; 7]> {
        let tools = tool_contact(&self.terms).map_or(&[][..], |c| &c.tools);
        tools.iter().map(|t| t.from.numbers()).collect()
    }

    /// Restores tool poses from [`CpuBody::tool_places`].
    pub(in crate::physics::cpu) fn resume_tools(&mut self, places: &[[f64; 7]]) {
        if let Some(contact) = tool_contact_mut(&mut self.terms) {
            for (tool, numbers) in contact.tools.iter_mut().zip(places) {
                tool.from = LocalToolPose::of_numbers(*numbers);
                tool.at = tool.from;
            }
        }
    }

    /// Returns the boundary surface, each face with the stiffness of the material behind it.
    fn hull(&self, faces: &[[u32; 3]], network: &DiscreteModel) -> BoundarySurface {
        let faces: Vec<([u32; 3], f64)> = face_stiffnesses(faces, network, &self.units)
            .map(|(face, young)| (face.map(|v| self.engine_index[v as usize]), young))
            .collect();
        let places = self.node_order.iter().map(|v| self.rest[*v as usize]);
        BoundarySurface::new(places.map(|x| x / self.units.length).collect(), &faces)
    }
}
