//! Balance of the static forces of a body: how far it is from equilibrium.

use super::Loads;
use crate::physics::{DiscreteModel, NodeTerm};
use glam::DVec3;
use std::sync::Arc;

/// Largest net force of a body in equilibrium, relative to the loads: without contact, and with
/// contact, whose steps are solved less exactly.
const EQUILIBRIUM_TOLERANCE: f64 = 1e-4;
const CONTACT_EQUILIBRIUM_TOLERANCE: f64 = 1e-2;

/// Largest part of the net force, relative to the loads, that may be attributed to rounding.
const MAX_ROUNDING_RATIO: f64 = 1e-2;

/// Movement of a node that is negligible for all loads, over the extent of the body: residual
/// motion below this does not prevent sleep.
const NEGLIGIBLE_MOVEMENT: f64 = 1e-16;

/// Static forces of a body, without inertia and damping: root sums of squares over its nodes, N.
/// A rigid region counts as one node, with its net moment over its radius.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceBalance {
    /// Net forces on the free nodes.
    pub residual: f64,
    /// Loads.
    pub loads: f64,
    /// Loads, or the reactions of the supports if these are larger.
    pub scale: f64,
    /// Rounding error of the net forces at the precision of the engine's displacements.
    pub rounding: f64,
    /// Net forces that are negligible whatever the loads.
    pub negligible: f64,
    /// Number of free nodes.
    pub nodes: usize,
    /// Whether tools or self-contact act.
    pub contact: bool,
}

impl ForceBalance {
    /// Returns an estimate of the relative error of displacements due to rounding. Errors of
    /// different nodes are independent and the loads are not, so that it falls with the root of
    /// their number; 0 without loads (reactions of a body at rest are rounding errors themselves).
    pub fn rounding_error(&self) -> f64 {
        match self.loads > 0.0 {
            true => self.rounding / (self.scale * (self.nodes.max(1) as f64).sqrt()),
            false => 0.0,
        }
    }

    /// Whether the body is in equilibrium, with a tolerance relative to the loads or to
    /// `reference` (N) if that is larger.
    pub fn is_equilibrium(&self, reference: f64) -> bool {
        let rounding = self.rounding.min(MAX_ROUNDING_RATIO * self.scale);
        let tolerance = match self.contact {
            true => CONTACT_EQUILIBRIUM_TOLERANCE,
            false => EQUILIBRIUM_TOLERANCE,
        };
        self.residual <= tolerance * self.scale.max(reference) + rounding + self.negligible
    }
}

/// Sums of squares of which a [`ForceBalance`] is made, N².
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics) struct ForceSums {
    residual: f64,
    loads: f64,
    reactions: f64,
    rounding: f64,
    negligible: f64,
    nodes: usize,
    /// Whether tools or self-contact act.
    pub contact: bool,
}

impl ForceSums {
    /// Adds a node with its internal force, load and rounding error, N. A constrained node is
    /// supported by its reaction.
    pub fn add(&mut self, internal: DVec3, load: DVec3, free: bool, rounding: f64) {
        self.loads += load.length_squared();
        if free {
            self.residual += (internal + load).length_squared();
            self.rounding += rounding * rounding;
            self.nodes += 1;
        } else {
            self.reactions += internal.length_squared();
        }
    }

    /// Adds the force that would move a node of this `stiffness` (N/m) negligibly in a body of this
    /// `extent` (m).
    pub fn add_negligible(&mut self, stiffness: f64, extent: f64) {
        self.negligible += (NEGLIGIBLE_MOVEMENT * stiffness * extent).powi(2);
    }

    /// Adds the net force and moment (over a radius) of a rigid region, N.
    pub fn add_rigid(&mut self, force: DVec3, moment: DVec3, load: DVec3, rounding: f64) {
        self.residual += force.length_squared() + moment.length_squared();
        self.loads += load.length_squared();
        self.rounding += rounding * rounding;
        self.nodes += 1;
    }

    /// Adds another body.
    pub fn add_body(&mut self, other: ForceBalance) {
        self.residual += other.residual * other.residual;
        self.loads += other.loads * other.loads;
        self.reactions += other.scale * other.scale;
        self.rounding += other.rounding * other.rounding;
        self.negligible += other.negligible * other.negligible;
        self.nodes += other.nodes;
        self.contact |= other.contact;
    }

    /// Returns the balance.
    pub fn balance(&self) -> ForceBalance {
        ForceBalance {
            residual: self.residual.sqrt(),
            loads: self.loads.sqrt(),
            scale: self.loads.max(self.reactions).sqrt(),
            rounding: self.rounding.sqrt(),
            negligible: self.negligible.sqrt(),
            nodes: self.nodes,
            contact: self.contact,
        }
    }
}

/// Returns the balance of the model `model` under `loads` and `terms` with the nodes at
/// `positions` (file units), which are rounded to `resolution` (m); `None` if a rigid region may
/// still turn about its constraints.
pub(in crate::physics) fn balance_of_model(
    model: &DiscreteModel,
    loads: &Loads,
    terms: &[Arc<dyn NodeTerm>],
    positions: &[DVec3],
    resolution: f64,
) -> Option<ForceBalance> {
    let x: Vec<DVec3> = positions.iter().map(|p| model.to_metres(*p)).collect();
    let internal = model.static_forces(&x, terms);
    let external = loads.static_forces(&model.masses, positions);
    let stiffness = model.nodal_stiffness();
    let constrained = loads.fixed_nodes();
    let extent = model.frame.scale * model.length_unit;
    let rigid = model.rigid_bodies();
    let mut is_rigid = vec![false; x.len()];
    let mut sums = ForceSums::default();
    for region in rigid {
        let nodes = || region.nodes.iter().map(|v| *v as usize);
        nodes().for_each(|v| is_rigid[v] = true);
        let force: DVec3 = nodes().map(|v| internal[v]).sum();
        let load: DVec3 = nodes().map(|v| external[v]).sum();
        let error = nodes().map(|v| resolution * stiffness[v]).sum();
        match nodes().filter(|v| constrained[*v]).count() {
            0 => {
                let count = region.nodes.len().max(1) as f64;
                let centre = nodes().map(|v| x[v]).sum::<DVec3>() / count;
                let moment = nodes().map(|v| (x[v] - centre).cross(internal[v] + external[v]));
                let squares = nodes().map(|v| x[v].distance_squared(centre));
                let radius = (squares.sum::<f64>() / count).sqrt();
                let moment = moment.sum::<DVec3>() / radius.max(f64::MIN_POSITIVE);
                sums.add_rigid(force + load, moment, load, error);
            }
            1 | 2 => return None,
            _ => sums.add(force, load, false, 0.0),
        }
    }
    for v in (0..x.len()).filter(|v| !is_rigid[*v]) {
        let free = !constrained[v] && model.masses[v] > 0.0;
        sums.add(internal[v], external[v], free, resolution * stiffness[v]);
        sums.add_negligible(stiffness[v], extent);
    }
    Some(sums.balance())
}
