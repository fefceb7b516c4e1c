//! Cages: coarse bodies generated from fine ones.

use super::cells_to_body::{lattice, model_of, particles};
use super::lattice::Cells;
use super::stiffness_fit::{ConstrainedModel, compliance, gravity_loads};
use crate::mesh::{BarycentricMap, TetMesh};
use crate::physics::DiscreteModel;
use crate::physics::grid::GridModel;
use crate::{Error, Result};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

/// Valid number of cage nodes.
const NODES: std::ops::RangeInclusive<usize> = 8..=4_000_000;
/// Minimum total weight of pinned cage nodes in the embedding of a pinned fine node.
const PINNED_WEIGHT: f64 = 0.75;
/// Fitted stiffness factors outside of this range are rejected.
const VALID_STIFFNESS_SCALE: std::ops::RangeInclusive<f64> = 0.02..=50.0;

/// Discretisation of a cage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CageKind {
    /// Tetrahedra, five per cell, for any solver.
    #[default]
    Lattice,
    /// Particles at the corners of the cells, with springs to 18 neighbours: a grid body,
    /// integrated by the Verlet method.
    Grid,
}

impl CageKind {
    /// Returns the name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            CageKind::Lattice => "lattice",
            CageKind::Grid => "grid",
        }
    }
}

impl fmt::Display for CageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CageKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<CageKind> {
        match name {
            "lattice" => Ok(CageKind::Lattice),
            "grid" => Ok(CageKind::Grid),
            _ => Err(Error::Input(format!(
                "unknown cage kind \"{name}\"; available: lattice, grid"
            ))),
        }
    }
}

/// Statistics of a cage.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CageReport {
    /// Number of moving nodes.
    pub nodes: usize,
    /// Cell sides, in file units.
    pub spacing: [f64; 3],
    /// Fine nodes outside of its tetrahedra.
    #[serde(rename = "outside")]
    pub nodes_outside: usize,
    /// Factor by which its stiffness was scaled to match the compliance of the fine body.
    #[serde(rename = "fitted")]
    pub stiffness_scale: f64,
    /// Damping rate of the lowest mode, 1/s.
    pub damping: f64,
}

/// A coarse body that embeds a fine one: cells around the fine mesh, with its mass and stiffness.
///
/// Each cell has the mass of its content of the fine body, and the mean of its moduli over the
/// whole cell; so partly filled cells are lighter and softer. A lattice around a body of finite
/// elements has elements with the same constitutive model. Otherwise cells have springs, which are
/// isotropic in full cells. Parts of the body in the same cell are coupled.
#[derive(Clone, Debug)]
pub struct Cage {
    /// The tetrahedra that embed the fine nodes, in the unit of the fine mesh.
    pub mesh: TetMesh,
    /// Its masses, and its springs or elements.
    pub model: DiscreteModel,
    /// The grid model, for [`CageKind::Grid`].
    pub grid: Option<GridModel>,
    transfer: BarycentricMap,
    /// For each node, the sum of its weights over all fine nodes.
    influence: Vec<f64>,
    report: CageReport,
}

impl Cage {
    /// Creates a cage of about `nodes` nodes around `mesh`, a body with the model `discrete_model`.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid number of nodes, rigid regions, or a grid cage around a body
    /// of finite elements; [`Error::Mesh`] for a mesh without volume.
    pub fn new(
        mesh: &TetMesh,
        discrete_model: &DiscreteModel,
        kind: CageKind,
        nodes: usize,
    ) -> Result<Cage> {
        if !NODES.contains(&nodes) {
            return Err(Error::Input(format!(
                "number of cage nodes must be {} to {}, got {nodes}",
                NODES.start(),
                NODES.end()
            )));
        }
        if !discrete_model.rigid_bodies().is_empty() {
            return Err(Error::Input(
                "a cage does not support rigid regions; make them elastic, or simulate the body without a cage"
                    .into(),
            ));
        }
        if kind == CageKind::Grid && discrete_model.elements().is_some() {
            return Err(Error::Input(
                "a cage of kind \"grid\" needs a body of springs; use springs, or a cage of kind \"lattice\""
                    .into(),
            ));
        }
        let cells = Cells::cover(mesh, discrete_model, nodes)?;
        let (own, own_model, grid) = match kind {
            CageKind::Lattice => {
                let (own, own_model) = lattice(&cells, discrete_model)?;
                (own, own_model, None)
            }
            CageKind::Grid => {
                let model = particles(&cells, discrete_model)?;
                let own = model.shape.mesh(&model.springs)?;
                let own_model = model_of(&model, discrete_model);
                (own, own_model, Some(model))
            }
        };
        let transfer = BarycentricMap::new(&own, &mesh.nodes)?;
        let mut influence = vec![0.0; own.nodes.len()];
        let mut outside = 0;
        for (corners, weights) in transfer.source_weights() {
            outside += usize::from(weights.iter().any(|w| *w < -1e-6));
            for (v, w) in corners.iter().zip(weights) {
                influence[*v as usize] += w.max(0.0);
            }
        }
        let report = CageReport {
            nodes: own_model.masses.iter().filter(|m| **m > 0.0).count(),
            spacing: cells.spacing.to_array(),
            nodes_outside: outside,
            stiffness_scale: 1.0,
            damping: 0.0,
        };
        Ok(Cage {
            mesh: own,
            model: own_model,
            grid,
            transfer,
            influence,
            report,
        })
    }

    /// Returns the barycentric weights of the fine nodes.
    pub fn transfer(&self) -> &BarycentricMap {
        &self.transfer
    }

    /// Returns statistics of the cage.
    pub fn report(&self) -> CageReport {
        self.report
    }

    /// Returns the cage nodes that represent the fine nodes `fine`: those with more than half of
    /// their total weight in these, and further ones until the chosen nodes have most of the weight
    /// of each of these.
    pub fn coarse_nodes_for(&self, fine: &[u32]) -> Vec<u32> {
        let shares = self.transfer.source_weights();
        let carriers: Vec<&([u32; 4], [f64; 4])> = fine
            .iter()
            .filter_map(|v| shares.get(*v as usize))
            .collect();
        let mut own = BTreeMap::new();
        for (corners, weights) in &carriers {
            for (v, w) in corners.iter().zip(weights) {
                *own.entry(*v).or_insert(0.0) += w.max(0.0);
            }
        }
        let mostly = |(v, sum): &(&u32, &f64)| **sum > 0.5 * self.influence[**v as usize];
        let mut chosen: BTreeSet<u32> = own.iter().filter(mostly).map(|(v, _)| *v).collect();
        for (corners, weights) in carriers {
            let mut order = [0, 1, 2, 3];
            order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
            let has = |k: &usize| chosen.contains(&corners[*k]);
            let mut held: f64 = order.iter().filter(|k| has(k)).map(|k| weights[*k]).sum();
            for k in order {
                if held < PINNED_WEIGHT && chosen.insert(corners[k]) {
                    held += weights[k];
                }
            }
        }
        chosen.into_iter().collect()
    }

    /// Scales the stiffness of the whole cage by one factor, so that the cage pinned at `pinned`
    /// has the same compliance as the fine body pinned at `fine_pinned`, for small displacements:
    /// equal work of `load`, N on the fine nodes; without a load, of gravity along the three axes.
    /// This compensates that coarse cells are stiffer in bending than fine ones. Also computes the
    /// damping rate of the lowest mode.
    ///
    /// Bodies without pins are clamped at one end for the fit, see
    /// `DiscreteModel::find_clamped_end`.
    ///
    /// Returns the factor, 1 if the fit fails.
    ///
    /// # Errors
    /// [`Error::Input`] if the numbers of nodes, pins and loads differ.
    pub fn fit_stiffness(
        &mut self,
        fine: &DiscreteModel,
        fine_pinned: &[bool],
        pinned: &[bool],
        load: Option<&[DVec3]>,
    ) -> Result<f64> {
        if fine_pinned.len() != fine.rest_positions.len()
            || fine.rest_positions.len() != self.transfer.source_weights().len()
            || pinned.len() != self.model.rest_positions.len()
        {
            return Err(Error::Input(format!(
                "number of pin flags must equal the number of nodes, got {} and {} for {} fine nodes and {} cage nodes",
                fine_pinned.len(),
                pinned.len(),
                self.transfer.source_weights().len(),
                self.model.rest_positions.len()
            )));
        }
        let (fine_pinned, pinned) = match fine_pinned.contains(&true) {
            true => (fine_pinned.to_vec(), pinned.to_vec()),
            false => self.held_at_one_end(fine),
        };
        let (fine_loads, loads) = match load {
            Some(load) => (
                vec![load.to_vec()],
                vec![self.transfer.apply_transpose(load)?],
            ),
            None => (gravity_loads(fine), gravity_loads(&self.model)),
        };
        let coarse = ConstrainedModel::new(&self.model, &pinned);
        let fine = ConstrainedModel::new(fine, &fine_pinned);
        if !coarse.has_free_nodes() || !fine.has_free_nodes() {
            return Ok(1.0);
        }
        let given = coarse.solve_cases(&loads, None);
        let start: Vec<Vec<DVec3>> = given
            .iter()
            .map(|u| self.transfer.apply(u))
            .collect::<Result<_>>()?;
        let fine_given = fine.solve_cases(&fine_loads, Some(&start));
        let factor = compliance(&loads, &given) / compliance(&fine_loads, &fine_given);
        let damping = self.model.damping_time * fine.lowest_eigenvalue(&fine_loads, &fine_given);
        if !VALID_STIFFNESS_SCALE.contains(&factor) {
            return Ok(1.0);
        }
        for edge in &mut self.model.edges {
            edge.stiffness *= factor;
        }
        if let Some(elements) = self.model.elements_mut() {
            for element in &mut elements.tets {
                element.lame_parameters = element.lame_parameters.map(|l| l * factor);
            }
        }
        if let Some(grid) = &mut self.grid {
            grid.stiffness = grid.stiffness.map(|k| k * factor);
            grid.damping = damping;
        }
        self.report.stiffness_scale *= factor;
        self.report.damping = damping;
        Ok(factor)
    }

    /// Returns pins of the fine body and of the cage at the end chosen by
    /// [`DiscreteModel::find_clamped_end`].
    fn held_at_one_end(&self, fine: &DiscreteModel) -> (Vec<bool>, Vec<bool>) {
        let held = fine.find_clamped_end(DVec3::NEG_Z).0.nodes;
        let mut fine_pinned = vec![false; fine.rest_positions.len()];
        for v in &held {
            fine_pinned[*v as usize] = true;
        }
        let mut pinned = vec![false; self.model.rest_positions.len()];
        for v in self.coarse_nodes_for(&held) {
            pinned[v as usize] = true;
        }
        (fine_pinned, pinned)
    }
}
