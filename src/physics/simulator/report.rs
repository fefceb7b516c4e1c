//! The state of a body in numbers, computed in float64 from positions and velocities read back.

use crate::mesh::{TetMesh, bounds, signed_volume};
use crate::parallel;
use crate::physics::Energy;
use glam::DVec3;

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
