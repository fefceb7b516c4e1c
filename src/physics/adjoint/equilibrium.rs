//! A body at rest or in a step: its model, its state, its loads and its measured forces.

use crate::mesh::TetMesh;
use crate::physics::{
    DiscreteModel, ForceBalance, Material, Muscle, NodeTerm, SelfContactSettings, Tool, ToolId,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Forces of a body, as the engine measures them.
#[derive(Clone, Debug, Default)]
pub(super) struct MeasuredForces {
    /// Force on each tool, and its moment.
    pub tools: Vec<[DVec3; 2]>,
    /// Sum of the forces on each node.
    pub nodes: Vec<DVec3>,
    /// Force on each rigid body, and its moment.
    pub rigid: Vec<[DVec3; 2]>,
}

/// A body at rest, or in a step.
pub(super) struct Equilibrium<'a> {
    pub mesh: &'a TetMesh,
    pub material: &'a Material,
    pub network: &'a DiscreteModel,
    pub terms: &'a [Arc<dyn NodeTerm>],
    pub tools: &'a [Tool],
    /// Boundary faces.
    pub faces: &'a [[u32; 3]],
    /// Muscles with the indices of their amplitudes.
    pub muscles: Vec<(&'a Muscle, usize)>,
    pub self_contact: Option<&'a SelfContactSettings>,
    /// Amplitudes of pressures and muscles.
    pub amplitudes: Vec<f64>,
    pub gravity: DVec3,
    pub pinned: &'a [bool],
    /// Nodes that are pinned or held.
    pub fixed: Vec<bool>,
    /// Element of each tet.
    pub element_of_tet: Vec<Option<usize>>,
    /// Positions, m from the origin of the frame.
    pub x: Vec<DVec3>,
    /// Force of inertia and mass damping over the mass of every node, m/s²; empty at rest.
    pub inertia: Vec<DVec3>,
    pub forces: MeasuredForces,
}

/// Returns the element of each tet of `mesh`, with the model `network`; `None` for springs.
pub(super) fn elements_of_tets(network: &DiscreteModel, mesh: &TetMesh) -> Vec<Option<usize>> {
    match network.elements() {
        Some(elements) => elements.of_tets(mesh),
        None => vec![None; mesh.tets.len()],
    }
}

/// Returns the net force over the loads.
///
/// # Errors
/// [`Error::Input`] if the body is not at rest.
pub(super) fn check_balance(balance: &ForceBalance) -> Result<f64> {
    let imbalance = match balance.scale > 0.0 {
        true => balance.residual / balance.scale,
        false => 0.0,
    };
    match balance.is_equilibrium(0.0) {
        true => Ok(imbalance),
        false => Err(Error::Input(format!(
            "a gradient requires a body at rest, but the net force is {imbalance:.1e} times the loads; take more or longer implicit steps"
        ))),
    }
}

impl Equilibrium<'_> {
    /// Checks that the nodes exist.
    pub fn check_nodes(&self, nodes: impl IntoIterator<Item = u32>) -> Result<()> {
        let count = self.x.len();
        match nodes.into_iter().find(|v| *v as usize >= count) {
            None => Ok(()),
            Some(v) => Err(Error::Input(format!(
                "node {v} does not exist; the body has {count} nodes"
            ))),
        }
    }

    /// Checks that the tets exist.
    pub fn check_tets(&self, tets: &[u32]) -> Result<()> {
        let count = self.mesh.tets.len();
        match tets.iter().find(|t| **t as usize >= count) {
            None => Ok(()),
            Some(t) => Err(Error::Input(format!(
                "tet {t} does not exist; the mesh has {count} tets"
            ))),
        }
    }

    /// Checks that the nodes are fixed and not rigid.
    pub fn check_fixed(&self, nodes: &[u32]) -> Result<()> {
        self.check_nodes(nodes.iter().copied())?;
        if let Some(v) = nodes.iter().find(|v| self.is_rigid(**v)) {
            return Err(Error::Input(format!(
                "node {v} belongs to a rigid region, whose supports share its force; use the force on the region"
            )));
        }
        match nodes.iter().find(|v| !self.fixed[**v as usize]) {
            None => Ok(()),
            Some(v) => Err(Error::Input(format!(
                "node {v} is not a support; give nodes that are pinned or held"
            ))),
        }
    }

    /// Whether tools or self-contact have friction.
    pub fn has_friction(&self) -> bool {
        self.self_contact.is_some_and(|own| own.friction > 0.0)
            || self.tools.iter().any(|tool| tool.friction > 0.0)
    }

    /// Checks that the tool exists.
    pub fn check_tool(&self, tool: ToolId) -> Result<()> {
        match tool.0 < self.tools.len() {
            true => Ok(()),
            false => Err(Error::Input(format!("this body has no tool {}", tool.0))),
        }
    }

    /// Whether a node belongs to a rigid region.
    pub fn is_rigid(&self, node: u32) -> bool {
        let mut bodies = self.network.rigid_bodies().iter();
        bodies.any(|body| body.nodes.binary_search(&node).is_ok())
    }

    /// Returns the first tet of each element: its own, or its first piece, whose material it has.
    pub fn first_tets(&self) -> Vec<u32> {
        let mut first = vec![u32::MAX; self.network.tets().len()];
        for (t, element) in self.element_of_tet.iter().enumerate() {
            if let Some(element) = element {
                first[*element] = first[*element].min(t as u32);
            }
        }
        first
    }
}
