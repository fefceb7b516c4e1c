//! Energies of a body, measured in float64.

use super::discrete_model::DiscreteModel;
use super::discretisation::{Discretisation, Edge};
use super::node_term::NodeTerm;
use crate::parallel;
use glam::DVec3;
use std::sync::Arc;

/// Energies of a body, J.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Energy {
    /// Kinetic energy, Σ ½mv².
    pub kinetic: f64,
    /// In the springs, Σ ½κ(|x| − L)², or in the elements, and in the additional terms.
    pub elastic: f64,
    /// Kinetic and elastic.
    pub total: f64,
}

impl Energy {
    /// Energies at a state given in file units.
    pub(crate) fn from_state(
        model: &DiscreteModel,
        terms: &[Arc<dyn NodeTerm>],
        positions: &[DVec3],
        velocities: &[DVec3],
    ) -> Energy {
        let unit = model.length_unit;
        let of_spring = |s: &Edge| {
            let [a, b] = s.nodes.map(|v| positions[v as usize]);
            0.5 * s.stiffness * (a.distance(b) * unit - s.length).powi(2)
        };
        let matter: f64 = match &model.discretisation {
            Discretisation::Springs(_) => {
                parallel::sum(model.edges.len(), |e| of_spring(&model.edges[e]))
            }
            Discretisation::Elements(elements) => {
                let x: Vec<DVec3> = positions.iter().map(|p| model.to_metres(*p)).collect();
                elements.energy(&x)
            }
        };
        let of_nodes = terms.iter().map(|term| -> f64 {
            let nodes = model.masses.iter().zip(positions);
            nodes
                .map(|(m, x)| term.energy(*m, model.to_metres(*x)))
                .sum()
        });
        let elastic = matter + of_nodes.sum::<f64>();
        let kinetic = parallel::sum(velocities.len(), |v| {
            0.5 * model.masses[v] * (velocities[v] * unit).length_squared()
        });
        Energy {
            kinetic,
            elastic,
            total: kinetic + elastic,
        }
    }
}
