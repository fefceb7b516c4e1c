//! Energies, volume and displacement of a body, computed in float64 from its state.

use super::{DiscreteModel, GpuBody, NodeTerm, Spring};
use crate::Result;
use crate::mesh::{TetMesh, bounds, signed_volume};
use crate::parallel;
use glam::DVec3;
use std::sync::Arc;

/// Energies of a body, J.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Energy {
    /// Kinetic energy, Σ ½mv².
    pub kinetic: f64,
    /// Elastic energy of the springs, Σ ½κ(|x| − L)², or of the elements, and of the node terms.
    pub elastic: f64,
    /// Sum of kinetic and elastic energy.
    pub total: f64,
}

/// Statistics of the state of a body.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Report {
    /// Energies, J.
    pub energy: Energy,
    /// Present volume over volume at rest.
    pub volume_ratio: f64,
    /// Maximum displacement of a node, in file units.
    pub max_displacement: f64,
    /// The largest extent of the bounds at rest, in file units.
    pub extent: f64,
    /// Number of inverted tets.
    #[serde(rename = "inverted")]
    pub inverted_tets: usize,
}

impl Report {
    /// The report on `body`, built from `mesh`.
    ///
    /// # Errors
    /// Errors of reading back.
    pub fn new(body: &GpuBody, mesh: &TetMesh) -> Result<Report> {
        let positions = body.positions()?;
        let velocities = body.velocities()?;
        let energy = Energy::from_state(body.network(), body.terms(), &positions, &velocities);
        Ok(Report::from_positions(energy, mesh, &positions))
    }

    /// The report on a body with this energy and the node positions `positions`, in file units.
    pub(crate) fn from_positions(energy: Energy, mesh: &TetMesh, positions: &[DVec3]) -> Report {
        let volumes = parallel::map(mesh.tets.len(), |t| {
            signed_volume(mesh.tets[t].map(|v| positions[v as usize]))
        });
        let farthest = positions
            .iter()
            .zip(&mesh.nodes)
            .map(|(x, rest)| x.distance(*rest))
            .fold(0.0, f64::max);
        let (low, high) = bounds(&mesh.nodes);
        Report {
            energy,
            volume_ratio: volumes.iter().sum::<f64>() / mesh.volume(),
            max_displacement: farthest,
            extent: (high - low).max_element(),
            inverted_tets: volumes.iter().filter(|v| **v < 0.0).count(),
        }
    }
}

impl Energy {
    /// Computes the energies of a state given in file units.
    pub(crate) fn from_state(
        network: &DiscreteModel,
        terms: &[Arc<dyn NodeTerm>],
        positions: &[DVec3],
        velocities: &[DVec3],
    ) -> Energy {
        let unit = network.length_unit;
        let of_spring = |s: &Spring| {
            let [a, b] = s.nodes.map(|v| positions[v as usize]);
            0.5 * s.stiffness * (a.distance(b) * unit - s.length).powi(2)
        };
        let elements = &network.elements;
        let matter: f64 = match elements.is_empty() {
            true => parallel::sum(network.springs.len(), |s| of_spring(&network.springs[s])),
            false => {
                let x: Vec<DVec3> = positions.iter().map(|p| network.to_metres(*p)).collect();
                elements.energy(&x)
            }
        };
        let of_nodes = terms.iter().map(|term| -> f64 {
            let nodes = network.masses.iter().zip(positions);
            nodes
                .map(|(m, x)| term.energy(*m, network.to_metres(*x)))
                .sum()
        });
        let elastic = matter + of_nodes.sum::<f64>();
        let kinetic = parallel::sum(velocities.len(), |v| {
            0.5 * network.masses[v] * (velocities[v] * unit).length_squared()
        });
        Energy {
            kinetic,
            elastic,
            total: kinetic + elastic,
        }
    }
}
