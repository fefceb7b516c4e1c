//! A cage: a coarse body made from a fine one.

use super::lattice::Cells;
use super::stiffness_fit::{ConstrainedNetwork, compliance, gravity_loads};
use crate::mesh::generate::{Grid, Split, grid};
use crate::mesh::{BarycentricMap, LocalFrame, TET_EDGES, TetMesh};
use crate::physics::grid::{
    GridModel, GridShape, SPRING_KINDS, SPRING_OFFSETS, isotropic_stiffness,
};
use crate::physics::{DiscreteModel, Element, Elements, Material, Spring};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

/// Nodes that a cage may have.
const NODES: std::ops::RangeInclusive<usize> = 8..=4_000_000;
/// The least share of a held fine node's weights that held nodes of the cage have.
const PINNED_WEIGHT: f64 = 0.75;
/// Factors of stiffness beyond these are not believed.
const VALID_STIFFNESS_SCALE: std::ops::RangeInclusive<f64> = 0.02..=50.0;

/// What a cage is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CageKind {
    /// Tets over the cells, five each, stepped by any solver.
    #[default]
    Lattice,
    /// Particles at the corners of the cells, with springs to 18 neighbours: a grid body, stepped
    /// by Verlet.
    Grid,
}

impl CageKind {
    /// The name, as in scenes.
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
                "there is no cage \"{name}\"; there are lattice and grid"
            ))),
        }
    }
}

/// How a cage turned out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CageReport {
    /// Nodes that move.
    pub nodes: usize,
    /// Sides of a cell, in file units.
    pub spacing: [f64; 3],
    /// Fine nodes outside its tets.
    #[serde(rename = "outside")]
    pub nodes_outside: usize,
    /// What its stiffness was multiplied by so that it gives as the fine body does.
    #[serde(rename = "fitted")]
    pub stiffness_scale: f64,
    /// Rate of damping of the slowest swing, 1/s.
    pub damping: f64,
}

/// A coarse body that carries a fine one: cells around the fine mesh, with its mass and
/// stiffness.
///
/// Each cell has the mass of what it holds of the fine body, and the mean of its moduli over the
/// whole cell; so cells that are partly filled are lighter and softer. A lattice around a body of
/// finite elements is one of elements by the same law. Otherwise cells have springs, those of full
/// cells as stiff in all directions. Parts of the body that share a cell are one.
#[derive(Clone, Debug)]
pub struct Cage {
    /// The tets that carry the fine nodes, in the unit of the fine mesh.
    pub mesh: TetMesh,
    /// Its masses, and its springs or elements.
    pub network: DiscreteModel,
    /// The same as particles on a grid, where it is of that kind.
    pub grid: Option<GridModel>,
    transfer: BarycentricMap,
    /// Of each node: the sum of the weights with which it carries fine nodes.
    influence: Vec<f64>,
    report: CageReport,
}

impl Cage {
    /// A cage of about `nodes` nodes around `mesh`, a body with these masses and springs or
    /// elements.
    ///
    /// # Errors
    /// [`Error::Input`] for a number of nodes that makes no sense, rigid regions, or particles
    /// around a body of elements; [`Error::Mesh`] for a mesh without an inside.
    pub fn new(
        mesh: &TetMesh,
        network: &DiscreteModel,
        kind: CageKind,
        nodes: usize,
    ) -> Result<Cage> {
        if !NODES.contains(&nodes) {
            return Err(Error::Input(format!(
                "a cage of about {nodes} nodes cannot be made; ask for {} to {}",
                NODES.start(),
                NODES.end()
            )));
        }
        if !network.elements.rigid.is_empty() {
            return Err(Error::Input(
                "a cage has no rigid regions: leave them elastic, or simulate the body itself"
                    .into(),
            ));
        }
        if kind == CageKind::Grid && !network.elements.is_empty() {
            return Err(Error::Input(
                "a cage of kind \"grid\" has springs: give it a body of springs, or take a lattice"
                    .into(),
            ));
        }
        let cells = Cells::cover(mesh, network, nodes)?;
        let (own, own_network, grid) = match kind {
            CageKind::Lattice => {
                let (own, own_network) = lattice(&cells, network)?;
                (own, own_network, None)
            }
            CageKind::Grid => {
                let model = particles(&cells, network)?;
                let own = model.shape.mesh(&model.springs)?;
                let own_network = network_of(&model, network);
                (own, own_network, Some(model))
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
            nodes: own_network.masses.iter().filter(|m| **m > 0.0).count(),
            spacing: cells.spacing.to_array(),
            nodes_outside: outside,
            stiffness_scale: 1.0,
            damping: 0.0,
        };
        Ok(Cage {
            mesh: own,
            network: own_network,
            grid,
            transfer,
            influence,
            report,
        })
    }

    /// What carries each fine node.
    pub fn transfer(&self) -> &BarycentricMap {
        &self.transfer
    }

    /// How it turned out.
    pub fn report(&self) -> CageReport {
        self.report
    }

    /// The nodes that stand for these nodes of the fine mesh: those that carry more of them than
    /// of others, and so many more that each fine node is carried by them for the most part.
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

    /// Makes the cage stiffer or softer, all of it by one factor, so that the cage held at `pinned`
    /// gives as far as the fine body held at `fine_pinned`, for small displacements: the work of
    /// `load`, N on the fine nodes, is the same; without a load, that of the body's weight along
    /// the three axes. Coarse cells bend less readily than fine ones, and this makes up for it.
    /// Finds the damping of the slowest swing too.
    ///
    /// Bodies that hang on nothing are held at one end for it, as [`DiscreteModel::find_clamped_end`] finds it.
    ///
    /// Returns the factor, 1 where none could be found.
    ///
    /// # Errors
    /// [`Error::Input`] where the numbers of nodes, pins and loads differ.
    pub fn fit_stiffness(
        &mut self,
        fine: &DiscreteModel,
        fine_pinned: &[bool],
        pinned: &[bool],
        load: Option<&[DVec3]>,
    ) -> Result<f64> {
        if fine_pinned.len() != fine.rest_positions.len()
            || fine.rest_positions.len() != self.transfer.source_weights().len()
            || pinned.len() != self.network.rest_positions.len()
        {
            return Err(Error::Input(format!(
                "{} and {} pins are given for {} fine nodes and {} of the cage",
                fine_pinned.len(),
                pinned.len(),
                self.transfer.source_weights().len(),
                self.network.rest_positions.len()
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
            None => (gravity_loads(fine), gravity_loads(&self.network)),
        };
        let coarse = ConstrainedNetwork::new(&self.network, &pinned);
        let fine = ConstrainedNetwork::new(fine, &fine_pinned);
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
        let damping = self.network.damping_time * fine.lowest_eigenvalue(&fine_loads, &fine_given);
        if !VALID_STIFFNESS_SCALE.contains(&factor) {
            return Ok(1.0);
        }
        for spring in &mut self.network.springs {
            spring.stiffness *= factor;
        }
        for element in &mut self.network.elements.tets {
            element.lame_parameters = element.lame_parameters.map(|l| l * factor);
        }
        if let Some(grid) = &mut self.grid {
            grid.stiffness = grid.stiffness.map(|k| k * factor);
            grid.damping = damping;
        }
        self.report.stiffness_scale *= factor;
        self.report.damping = damping;
        Ok(factor)
    }

    /// Pins at the end that holds the fine body best, of it and of the cage.
    fn held_at_one_end(&self, fine: &DiscreteModel) -> (Vec<bool>, Vec<bool>) {
        let held = fine.find_clamped_end(DVec3::NEG_Z).0.nodes;
        let mut fine_pinned = vec![false; fine.rest_positions.len()];
        for v in &held {
            fine_pinned[*v as usize] = true;
        }
        let mut pinned = vec![false; self.network.rest_positions.len()];
        for v in self.coarse_nodes_for(&held) {
            pinned[v as usize] = true;
        }
        (fine_pinned, pinned)
    }
}

/// Springs of a cage with the given lists, damped as the fine body is.
fn damped_as(
    fine: &DiscreteModel,
    frame: LocalFrame,
    rest: Vec<DVec3>,
    masses: Vec<f64>,
    springs: Vec<Spring>,
) -> DiscreteModel {
    // One κ_d for springs of any length makes meshes of any fineness alike only by its share of
    // their stiffness.
    let total: f64 = fine.springs.iter().map(|s| s.stiffness).sum();
    let extra = match total > 0.0 {
        true => fine.damping * fine.springs.len() as f64 / total,
        false => 0.0,
    };
    DiscreteModel {
        rest_positions: rest,
        masses,
        springs,
        damping: 0.0,
        damping_time: fine.damping_time + extra,
        damping_kind: fine.damping_kind,
        frame,
        length_unit: fine.length_unit,
        ..DiscreteModel::default()
    }
}

/// Tets over the cells, and springs along their edges; of a body of elements the tets are some too.
///
/// A cell of five tets has each edge of the cell, and one diagonal of each face. With κ of the
/// edges as [`isotropic_stiffness`] has them, shared by four cells, and κ of the diagonals doubled, for
/// there is one in place of two, and shared by two cells, full cells are as stiff in all
/// directions.
fn lattice(cells: &Cells, fine: &DiscreteModel) -> Result<(TetMesh, DiscreteModel)> {
    let held = |c: [usize; 3]| cells.content(c.map(|n| n as i64)).occupied;
    let Grid { nodes, tets } = grid(cells.count, Split::Five, held)?;
    let place = |n: &[usize; 3]| cells.low + cells.spacing * DVec3::from(n.map(|i| i as f64));
    let mesh = TetMesh {
        nodes: nodes.iter().map(place).collect(),
        tets,
        length_unit: Some(fine.length_unit),
        ..TetMesh::default()
    };
    let unit = fine.length_unit;
    let shares = isotropic_stiffness(cells.spacing * unit, 1.0)?;
    let mut masses = vec![0.0; mesh.nodes.len()];
    let mut springs: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    let mut elements = Vec::new();
    for five in mesh.tets.chunks_exact(5) {
        let corner = |v: u32| nodes[v as usize];
        let lowest = five
            .iter()
            .flatten()
            .map(|v| corner(*v))
            .reduce(|a, b| [0, 1, 2].map(|k| a[k].min(b[k])))
            .unwrap_or_default();
        let content = cells.content(lowest.map(|n| n as i64));
        if !fine.elements.is_empty() {
            for tet in five {
                elements.push(element(&mesh, *tet, content.lame, fine)?);
            }
        }
        let mut edges: Vec<[u32; 2]> = five
            .iter()
            .flat_map(|tet| TET_EDGES.map(|[a, b]| [tet[a].min(tet[b]), tet[a].max(tet[b])]))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut corners: Vec<u32> = edges.iter().flatten().copied().collect();
        corners.sort_unstable();
        corners.dedup();
        for v in &corners {
            masses[*v as usize] += content.mass / corners.len() as f64;
        }
        for [a, b] in edges {
            let (p, q) = (corner(a), corner(b));
            let along = [0, 1, 2].map(|k| q[k] as i64 - p[k] as i64);
            let kind = SPRING_OFFSETS
                .iter()
                .position(|s| s.map(i64::abs) == along.map(i64::abs));
            let kappa = kind.map_or(0.0, |k| shares[k]);
            let axial = along.iter().filter(|n| **n != 0).count() == 1;
            let share = if axial { 0.25 } else { 1.0 };
            *springs.entry([a, b]).or_insert(0.0) += share * kappa * content.young;
        }
    }
    let frame = LocalFrame::from_mesh(&mesh);
    let rest: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| (*p - frame.origin) * unit)
        .collect();
    let springs = springs
        .into_iter()
        .map(|(nodes, stiffness)| {
            let [a, b] = nodes.map(|v| rest[v as usize]);
            Spring {
                nodes,
                stiffness,
                length: a.distance(b),
            }
        })
        .collect();
    let mut network = damped_as(fine, frame, rest, masses, springs);
    network.elements = Elements {
        tets: elements,
        rigid: Vec::new(),
        ..fine.elements.clone()
    };
    Ok((mesh, network))
}

/// A tet of `mesh` with Lamé's μ and λ, Pa, by the law of `fine`.
fn element(
    mesh: &TetMesh,
    tet: [u32; 4],
    [mu, lambda]: [f64; 2],
    fine: &DiscreteModel,
) -> Result<Element> {
    let young = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
    let poisson = 0.5 * lambda / (lambda + mu);
    let corners = tet.map(|v| mesh.nodes[v as usize] * fine.length_unit);
    Element::new(tet, corners, young, poisson, fine.elements.law).ok_or_else(|| {
        Error::Mesh(format!(
            "a cell of the cage would have a Young's modulus of {young} Pa and a Poisson's ratio of {poisson}; ask for fewer nodes"
        ))
    })
}

/// Particles at the corners of the cells: each has an eighth of the mass of the cells around it,
/// and the mean of their moduli.
fn particles(cells: &Cells, fine: &DiscreteModel) -> Result<GridModel> {
    // A layer of particles that the body has not lies around those of the cells.
    let size = cells.count.map(|n| n + 3);
    let total: usize = size.iter().product();
    let at = |i: usize| {
        let [nx, ny, _] = size;
        [i % nx, i / nx % ny, i / (nx * ny)].map(|n| n as i64 - 1)
    };
    let around = |p: [i64; 3]| {
        (0..8i64)
            .map(move |k| cells.content([p[0] - (k & 1), p[1] - (k >> 1 & 1), p[2] - (k >> 2)]))
    };
    let shape = GridShape {
        size,
        spacing: cells.spacing,
        axes: DMat3::IDENTITY,
        origin: cells.low - cells.spacing,
        regions: (0..total)
            .map(|i| u16::from(around(at(i)).any(|c| c.occupied)))
            .collect(),
        labels: vec![1],
    };
    let held = |c: [i64; 3]| cells.content(c).occupied;
    // Springs hold only what a cell holds.
    let mut springs = shape.springs();
    for (i, mask) in springs.iter_mut().enumerate() {
        let p = at(i);
        for bit in 0..2 * SPRING_KINDS {
            let step = SPRING_OFFSETS[bit / 2].map(|s| if bit % 2 == 0 { s } else { -s });
            let shared = (0..8i64).any(|k| {
                let cell = [p[0] - (k & 1), p[1] - (k >> 1 & 1), p[2] - (k >> 2)];
                let inside = |a: usize| (0..=1).contains(&(p[a] + step[a] - cell[a]));
                held(cell) && (0..3).all(inside)
            });
            if !shared {
                *mask &= !(1 << bit);
            }
        }
    }
    let means: Vec<f64> = (0..total)
        .map(|i| around(at(i)).map(|c| c.young).sum::<f64>() / 8.0)
        .collect();
    let body = means.iter().copied().fold(0.0, f64::max);
    let material = Material {
        length_unit: fine.length_unit,
        ..Material::from_young(body)
    };
    let mut model = GridModel::new(shape, &material)?;
    model.springs = springs;
    model.masses = (0..total)
        .map(|i| around(at(i)).map(|c| c.mass).sum::<f64>() / 8.0)
        .collect();
    model.stiffness_scales = means
        .iter()
        .map(|k| if body > 0.0 { k / body } else { 0.0 })
        .collect();
    Ok(model)
}

/// The masses and springs of a grid as a list.
fn network_of(model: &GridModel, fine: &DiscreteModel) -> DiscreteModel {
    let (shape, frame, unit) = (&model.shape, model.frame, model.length_unit);
    let offsets = shape.offsets();
    let lengths = shape.rest_lengths();
    let mut springs = Vec::new();
    for i in shape.particles() {
        for k in (0..SPRING_KINDS).filter(|k| model.springs[i] >> (2 * k) & 1 == 1) {
            let j = (i as i64 + offsets[k]) as usize;
            springs.push(Spring {
                nodes: [i.min(j) as u32, i.max(j) as u32],
                stiffness: 0.5
                    * (model.stiffness_scales[i] + model.stiffness_scales[j])
                    * model.stiffness[k],
                length: lengths[k] * unit,
            });
        }
    }
    springs.sort_unstable_by_key(|s| s.nodes);
    let rest = (0..shape.regions.len())
        .map(|i| (shape.rest_position(i) - frame.origin) * unit)
        .collect();
    damped_as(fine, frame, rest, model.masses.clone(), springs)
}
