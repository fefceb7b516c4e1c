//! Pins, constraints and target springs of the nodes of a body.

use super::{CpuBody, ForceStatus};
use crate::Result;
use crate::physics::cpu::implicit::contact_terms::self_contact;
use crate::physics::cpu::node_constraints::{NodeConstraint, check_attachments};
use crate::physics::cpu::rigid::target_springs::{RigidTargetSpring, RigidTargetSprings};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::find_term_mut;
use crate::physics::cpu::vectors::{dot_f64, from_metres, sub, zero};
use glam::DVec3;

/// Prescribed nodes that continue from within this fraction of the body's size of their positions
/// do not count as moved.
const CONTINUATION_DISTANCE: f64 = 1e-5;

impl<T: Real> CpuBody<T> {
    /// Sets the pinned nodes, which stay at rest.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a wrong number of flags.
    pub fn set_pinned(&mut self, pinned: &[bool]) -> Result<()> {
        self.check("pins", pinned.len())?;
        self.pinned.copy_from_slice(pinned);
        self.free_nodes();
        self.invalidate(ForceStatus::Resume);
        Ok(())
    }

    /// Replaces the constraints and target springs of nodes. Constrained nodes are moved to their
    /// positions at once, or, with self-contact, in the next step up to the first collision;
    /// schemes restart, as after a change of the state.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for invalid attachments.
    pub fn set_node_constraints(&mut self, attachments: &[NodeConstraint]) -> Result<()> {
        check_attachments(attachments, self.node_count())?;
        let same_nodes = self.held().eq(held(attachments));
        self.attachments.clear();
        self.attachments.extend_from_slice(attachments);
        let (place, rest, units) = (&self.engine_index, &self.rest, &self.units);
        let rigid = self.newton.as_ref().map(|newton| &newton.rigid);
        // Target springs on rigid bodies are a separate term.
        let soft = |a: &&NodeConstraint| match a {
            NodeConstraint::Spring { node, .. } => !rigid
                .is_some_and(|rigid| rigid.is_target_spring_node(place[*node as usize] as usize)),
            _ => true,
        };
        let draws: Vec<NodeConstraint> = attachments.iter().filter(soft).copied().collect();
        self.loads.set_target_springs(&draws, place, rest, units);
        let springs = rigid.map(|rigid| rigid.target_springs(attachments, (place, rest), units));
        self.set_target_springs(springs.unwrap_or_default());
        if !same_nodes {
            self.free_nodes();
        }
        let gradually = self.newton.is_some() && self_contact(&self.terms).is_some();
        self.moving_constraints.clear();
        let mut goes_on = same_nodes && !attachments.is_empty();
        for a in attachments {
            let (node, to, velocity) = match *a {
                NodeConstraint::Fixed { node, place } => {
                    goes_on = false;
                    (node, place, DVec3::ZERO)
                }
                NodeConstraint::Prescribed {
                    node,
                    place,
                    velocity,
                } => (node, place, velocity),
                NodeConstraint::Spring { .. } => {
                    goes_on = false;
                    continue;
                }
            };
            let v = node as usize;
            let k = self.engine_index[v] as usize;
            let to = from_metres(to - self.rest[v], self.units.length);
            let off = sub(to, self.state.u[k]);
            if gradually && matches!(a, NodeConstraint::Fixed { .. }) {
                let rigid = self.newton.as_ref().and_then(|n| n.rigid.body_of(k));
                self.moving_constraints
                    .extend(rigid.is_none().then_some((k, to)));
                continue;
            }
            goes_on &= dot_f64(off, off) < CONTINUATION_DISTANCE * CONTINUATION_DISTANCE;
            self.state.u[k] = to;
            self.state.v[k] = from_metres(velocity, self.units.velocity());
        }
        self.apply_constraints(gradually);
        // Prescribed nodes that continue from their positions leave the history of schemes valid.
        self.invalidate(match goes_on {
            true => ForceStatus::Resume,
            false => ForceStatus::Restart,
        });
        Ok(())
    }

    fn set_target_springs(&mut self, springs: Vec<RigidTargetSpring>) {
        let known: Option<&mut RigidTargetSprings<T>> = find_term_mut(&mut self.terms);
        if let Some(known) = known {
            known.set(springs, &self.plan);
        } else if !springs.is_empty() {
            let mut term = RigidTargetSprings::new(&self.plan);
            term.set(springs, &self.plan);
            self.add_term(Box::new(term));
        }
    }

    /// Returns which nodes of the network are fixed.
    pub(super) fn fixed_nodes(&self) -> Vec<bool> {
        let mut stays = self.pinned.clone();
        for v in held(&self.attachments) {
            stays[v as usize] = true;
        }
        stays
    }

    /// Whether any node has a prescribed motion.
    pub(super) fn has_prescribed_motion(&self) -> bool {
        let is_moving = |a: &NodeConstraint| matches!(a, NodeConstraint::Prescribed { velocity, .. } if *velocity != DVec3::ZERO);
        self.attachments.iter().any(is_moving)
    }

    fn held(&self) -> impl Iterator<Item = u32> {
        held(&self.attachments)
    }

    /// Updates the free nodes.
    pub(super) fn free_nodes(&mut self) {
        let stays = self.fixed_nodes();
        for (k, v) in self.node_order.iter().enumerate() {
            let m = self.masses[k];
            // A massless node has no equation of motion, so it is fixed.
            let over = T::ONE / m;
            let stay = stays.get(*v as usize).is_some_and(|stays| *stays);
            let free = !stay && m > T::ZERO && over.to_f64().is_finite();
            self.inverse_masses[k] = if free { over } else { T::ZERO };
            self.free_mask[k] = if free { T::ONE } else { T::ZERO };
            if !free {
                self.state.v[k] = zero();
            }
        }
        self.update_freedoms(&stays);
        if let Some(implicit) = &mut self.implicit {
            implicit.drop_coarse_space();
            implicit.clear_history();
        }
    }
}

fn held(attachments: &[NodeConstraint]) -> impl Iterator<Item = u32> {
    attachments.iter().filter_map(|a| match a {
        NodeConstraint::Fixed { node, .. } | NodeConstraint::Prescribed { node, .. } => Some(*node),
        NodeConstraint::Spring { .. } => None,
    })
}
