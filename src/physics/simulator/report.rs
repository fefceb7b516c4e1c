//! What became of a body, measured in float64 from its state read back.

use crate::Result;
use crate::mesh::{TetMesh, bounds, signed_volume};
use crate::parallel;
use crate::physics::{DiscreteModel, GpuBody, NodeTerm, Spring};
use glam::DVec3;
use std::sync::Arc;

/// Energies of a body, J.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Energy {
    /// Of motion, Σ ½mv².
    pub kinetic: f64,
    /// In the springs, Σ ½κ(|x| − L)², or in the elements, and in the terms beside them.
    pub elastic: f64,
    /// Kinetic and elastic.
    pub total: f64,
}

/// The state of a body, in numbers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Report {
    /// Energies, J.
    pub energy: Energy,
    /// Volume now over volume at rest.
    pub volume_ratio: f64,
    /// The farthest any node is from where it rested, in file units.
    pub max_displacement: f64,
    /// The largest extent of the bounds at rest, in file units.
    pub extent: f64,
    /// Tets turned inside out.
    #[serde(rename = "inverted")]
    pub inverted_tets: usize,
}

impl Report {
    /// The report on `body`, which is made of `mesh`.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn new(body: &GpuBody, mesh: &TetMesh) -> Result<Report> {
        let positions = body.positions()?;
        let velocities = body.velocities()?;
        let energy = Energy::from_state(body.network(), body.terms(), &positions, &velocities);
        Ok(Report::from_positions(energy, mesh, &positions))
    }

    /// The report on a body of that energy, whose nodes stand at `positions`, in file units.
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
    /// Energies at a state given in file units.
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
