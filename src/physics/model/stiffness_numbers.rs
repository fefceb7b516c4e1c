//! The dependence of elements and springs on the stiffness numbers of their material.

use super::discrete_model::DiscreteModel;
use super::material::Material;
use super::model_builder::{ModelBuilder, edges_around};
use crate::Result;
use crate::mesh::TetMesh;

/// For each edge, the derivative of its stiffness by the stiffness number of each incident tet.
pub(in crate::physics) type EdgeShares = Vec<Vec<(u32, f64)>>;

impl DiscreteModel {
    /// Returns the stiffness number of each tet of `mesh` in `material`, of which this model is
    /// made: Young's modulus in Pa or N/m of uniform springs, before factors of fields.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the mesh lacks a field.
    pub(in crate::physics) fn stiffness_numbers(
        &self,
        mesh: &TetMesh,
        material: &Material,
    ) -> Result<Vec<f64>> {
        Ok(ModelBuilder::new(mesh, material)?.stiffness_numbers())
    }

    /// Returns the dependence of each of the edges on the stiffness numbers of the tets of `mesh`.
    ///
    /// # Errors
    /// As [`DiscreteModel::stiffness_numbers`].
    pub(in crate::physics) fn edge_shares(
        &self,
        mesh: &TetMesh,
        material: &Material,
    ) -> Result<EdgeShares> {
        let builder = ModelBuilder::new(mesh, material)?;
        let around = edges_around(mesh);
        let groups = around.chunk_by(|a, b| a.0 == b.0);
        let shares = groups.map(|tets| builder.edge_shares(tets[0].0, tets, &self.rest_positions));
        Ok(shares.collect())
    }
}
