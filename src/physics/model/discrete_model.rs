//! The discrete model of a body: masses, edges, and springs or finite elements, in float64 and SI
//! units. Every engine creates its arrays from it.

use super::clamped_end::ClampedEnd;
use super::discretisation::{Discretisation, Edge, SpringNetwork};
use super::elements::{Element, Elements};
use super::material::Material;
use super::model_builder::{ModelBuilder, edges_around};
use super::rigid_region::RigidBody;
use crate::mesh::{LocalFrame, TetCut, TetMesh, replace_sorted};
use crate::{Error, Result};
use glam::DVec3;

/// Masses at the nodes of a mesh, and springs along its edges or finite elements in its tets.
///
/// Positions are in metres from the frame's origin.
#[derive(Clone, Debug, Default)]
pub struct DiscreteModel {
    /// Rest position of every node, m.
    pub rest_positions: Vec<DVec3>,
    /// Lumped mass of every node, kg: a quarter of the mass of its tets, and what was added. In a
    /// body of order 2 the tets are the pieces of its elements.
    pub masses: Vec<f64>,
    /// Masses added to nodes, which [`DiscreteModel::masses`] include, kg.
    pub added_masses: Vec<(u32, f64)>,
    /// Every edge of the mesh once, in sorted order.
    pub edges: Vec<Edge>,
    /// Stiffness-proportional damping, s: a damping matrix of this time times the stiffness matrix.
    pub damping_time: f64,
    /// The local frame of the mesh, in file units.
    pub frame: LocalFrame,
    /// Metres per file unit.
    pub length_unit: f64,
    /// The springs or finite elements.
    pub discretisation: Discretisation,
}

impl DiscreteModel {
    /// The springs, one along each of [`DiscreteModel::edges`]; `None` for finite elements.
    pub fn springs(&self) -> Option<&SpringNetwork> {
        self.discretisation.springs()
    }

    /// Mutable access to [`DiscreteModel::springs`].
    pub fn springs_mut(&mut self) -> Option<&mut SpringNetwork> {
        self.discretisation.springs_mut()
    }

    /// The finite elements; `None` for springs.
    pub fn elements(&self) -> Option<&Elements> {
        self.discretisation.elements()
    }

    /// Mutable access to [`DiscreteModel::elements`].
    pub fn elements_mut(&mut self) -> Option<&mut Elements> {
        self.discretisation.elements_mut()
    }

    /// The tets of the finite elements; empty for springs.
    pub fn tets(&self) -> &[Element] {
        self.discretisation.tets()
    }

    /// The rigid bodies; empty for springs.
    pub fn rigid_bodies(&self) -> &[RigidBody] {
        self.discretisation.rigid_bodies()
    }

    /// The two nodes of every edge, in sorted order.
    pub fn edge_nodes(&self) -> impl ExactSizeIterator<Item = [u32; 2]> {
        self.edges.iter().map(|edge| edge.nodes)
    }

    /// Chooses the clamped end of a body without supports, for loads in the direction `down`: a
    /// flat end, or the one it stands on; see [`ClampedEnd::of_largest_component`]. Also returns
    /// the number of components.
    pub(crate) fn find_clamped_end(&self, down: DVec3) -> (ClampedEnd, usize) {
        let edges = self.edge_nodes();
        ClampedEnd::of_largest_component(&self.rest_positions, &self.masses, edges, down)
    }

    /// Returns the time in which the slowest shear wave crosses the body, s: its extent over
    /// √(μ/ρ), or over the length of springs times √(κ/m); `None` without tets or springs.
    pub fn wave_crossing_time(&self) -> Option<f64> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for x in &self.rest_positions {
            (low, high) = (low.min(*x), high.max(*x));
        }
        let speed = match self.discretisation.tets() {
            [] => {
                let of = |edge: &Edge| {
                    let [a, b] = edge.nodes.map(|v| self.masses[v as usize]);
                    edge.length * (edge.stiffness / (0.5 * (a + b))).sqrt()
                };
                self.edges.iter().map(of).fold(f64::INFINITY, f64::min)
            }
            tets => {
                let volume: f64 = tets.iter().map(|t| t.volume).sum();
                let modulus = tets.iter().map(|t| t.lame_parameters[0]);
                let density = self.masses.iter().sum::<f64>() / volume;
                (modulus.fold(f64::INFINITY, f64::min) / density).sqrt()
            }
        };
        let time = low.distance(high) / speed;
        (time.is_finite() && time > 0.0).then_some(time)
    }

    /// The model of `mesh` made of `material`.
    ///
    /// # Errors
    /// [`Error::Input`] if a parameter is out of range or the mesh lacks a field.
    pub fn new(mesh: &TetMesh, material: &Material) -> Result<DiscreteModel> {
        material.check()?;
        let frame = LocalFrame::from_mesh(mesh);
        let unit = material.length_unit;
        let rest: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| (*p - frame.origin) * unit)
            .collect();
        let builder = ModelBuilder::new(mesh, material)?;
        let masses = builder.masses(0..mesh.tets.len())?;
        let edges = builder.edges(&edges_around(mesh), &rest)?;
        let discretisation = builder.discretisation(&rest)?;
        Ok(DiscreteModel {
            rest_positions: rest,
            masses,
            added_masses: Vec::new(),
            edges,
            damping_time: material.damping_time,
            frame,
            length_unit: unit,
            discretisation,
        })
    }

    /// Adds a mass to each of the given nodes, kg, which stays there when the body is cut.
    pub fn add_masses(&mut self, masses: impl IntoIterator<Item = (u32, f64)>) {
        for (v, mass) in masses {
            self.masses[v as usize] += mass;
            self.added_masses.push((v, mass));
        }
    }

    /// Applies `cut`, which produced `mesh` from this model's mesh: duplicated nodes share the mass
    /// of their tets, and their edges are recomputed from the tets around them, so that the model
    /// equals [`DiscreteModel::new`] of the new mesh. Returns the edges at duplicated nodes. Takes
    /// time proportional to the cut, except for shifting the lists.
    ///
    /// # Errors
    /// As [`DiscreteModel::new`], and [`Error::Input`] if `mesh` is not the cut mesh; nothing is
    /// changed then.
    pub fn apply_cut(
        &mut self,
        mesh: &TetMesh,
        material: &Material,
        cut: &TetCut,
    ) -> Result<Vec<Edge>> {
        if mesh.nodes.len() != self.rest_positions.len() + cut.duplicated_nodes.len() {
            return Err(Error::Input(format!(
                "cannot apply the cut to a body of {} nodes: it duplicated {} nodes, but the cut mesh has {}; apply every cut in order",
                self.rest_positions.len(),
                cut.duplicated_nodes.len(),
                mesh.nodes.len()
            )));
        }
        if !cut.removed.is_empty() {
            let frame = self.frame;
            let new = DiscreteModel::new(mesh, material)?;
            let old = std::mem::replace(self, new);
            self.add_masses(old.added_masses.iter().copied());
            if let (Some(elements), Some(old)) = (self.elements_mut(), old.elements()) {
                elements.mass_damping = old.mass_damping;
                elements.per_tet_lambda_ratio = old.per_tet_lambda_ratio;
            }
            // Positions stay in their present frame.
            let moved = (self.frame.origin - frame.origin) * self.length_unit;
            self.rest_positions.iter_mut().for_each(|x| *x += moved);
            self.frame = frame;
            return Ok(Vec::new());
        }
        let builder = ModelBuilder::new(mesh, material)?;
        let mut rest = self.rest_positions.clone();
        rest.extend(
            cut.duplicated_nodes
                .iter()
                .map(|[_, old]| self.rest_positions[*old as usize]),
        );
        let masses = builder.masses(cut.incident_tets.iter().map(|t| *t as usize))?;
        let edges = builder.edges(&cut.edge_tets, &rest)?;
        if let Discretisation::Elements(elements) = &mut self.discretisation {
            builder.renumber(elements, &cut.incident_tets, &rest)?;
        }
        replace_sorted(&mut self.edges, |e| e.nodes, &cut.previous_edges, &edges);
        self.masses.resize(mesh.nodes.len(), 0.0);
        for v in &cut.nodes {
            let added = self.added_masses.iter().filter(|(node, _)| node == v);
            self.masses[*v as usize] = masses[*v as usize] + added.map(|(_, m)| m).sum::<f64>();
        }
        self.rest_positions = rest;
        Ok(edges)
    }

    /// Returns κ_d of a spring along `edge`, N·s/m.
    pub fn spring_damping(&self, edge: &Edge) -> f64 {
        let constant = self.springs().map_or(0.0, |springs| springs.damping);
        constant + self.damping_time * edge.stiffness
    }

    /// Converts a point from file coordinates to metres from the frame's origin.
    pub fn to_metres(&self, p: DVec3) -> DVec3 {
        (p - self.frame.origin) * self.length_unit
    }

    /// Converts a point from metres from the frame's origin to file coordinates.
    pub fn to_file(&self, x: DVec3) -> DVec3 {
        self.frame.origin + x / self.length_unit
    }
}
