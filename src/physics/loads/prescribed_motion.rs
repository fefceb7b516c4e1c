//! Nodes whose motion is prescribed.

use super::Loads;
use crate::mesh::TetCut;
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Identifies a set of nodes with prescribed motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrescribedMotionId(usize);

/// Nodes with a prescribed displacement (Dirichlet condition), each with a position and a velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::physics) struct PrescribedMotion {
    nodes: Vec<u32>,
    #[serde(rename = "places")]
    positions: Vec<[f64; 3]>,
    velocities: Vec<[f64; 3]>,
}

impl PrescribedMotion {
    /// Each node with its position and velocity, in file units.
    pub fn iter(&self) -> impl Iterator<Item = (u32, DVec3, DVec3)> {
        let states = self.positions.iter().zip(&self.velocities);
        let nodes = self.nodes.iter().zip(states);
        nodes.map(|(v, (x, w))| (*v, DVec3::from(*x), DVec3::from(*w)))
    }

    /// Its nodes.
    pub(super) fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Whether it is a state of the nodes of `other`.
    pub(super) fn fits(&self, other: &PrescribedMotion) -> bool {
        self.nodes == other.nodes
            && [self.positions.len(), self.velocities.len()] == [self.nodes.len(); 2]
    }

    /// Updates it after a cut: duplicated nodes move as their originals.
    pub(super) fn apply_cut(&mut self, cut: &TetCut) {
        for [new, old] in &cut.duplicated_nodes {
            if let Some(k) = self.nodes.iter().position(|v| v == old) {
                self.nodes.push(*new);
                self.positions.push(self.positions[k]);
                self.velocities.push(self.velocities[k]);
            }
        }
    }
}

impl Loads {
    /// Prescribes the motion of `nodes`, which are at `positions` (file units), from now on. The
    /// engine must support it:
    /// [`Simulator::add_prescribed_motion`](crate::physics::Simulator::add_prescribed_motion).
    pub(in crate::physics) fn add_prescribed_motion(
        &mut self,
        nodes: &[u32],
        positions: &[DVec3],
    ) -> Result<PrescribedMotionId> {
        let constrained = self.constrained_nodes();
        if let Some(v) = nodes
            .iter()
            .find(|v| constrained.get(**v as usize) != Some(&false))
        {
            return Err(Error::Input(format!(
                "cannot prescribe the motion of node {v}: it is pinned, grabbed or already prescribed, or does not exist; remove one of its constraints"
            )));
        }
        if nodes.is_empty() || nodes.len() != positions.len() {
            return Err(Error::Input(format!(
                "got {} positions for {} nodes with prescribed motion; give one per node, and at least one node",
                positions.len(),
                nodes.len()
            )));
        }
        self.prescribed_motions.push(PrescribedMotion {
            nodes: nodes.to_vec(),
            positions: positions.iter().map(|p| p.to_array()).collect(),
            velocities: vec![[0.0; 3]; nodes.len()],
        });
        self.grabs_changed();
        Ok(PrescribedMotionId(self.prescribed_motions.len() - 1))
    }

    /// Sets the positions `positions` (file units) of nodes with prescribed motion, and the
    /// `velocities` (file units per second) at which they continue until the next call.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of values is wrong or one is not finite.
    pub fn set_prescribed_motion(
        &mut self,
        id: PrescribedMotionId,
        positions: &[DVec3],
        velocities: &[DVec3],
    ) -> Result<()> {
        let count = self
            .prescribed_motions
            .get(id.0)
            .map_or(0, |motion| motion.nodes.len());
        let finite = positions.iter().chain(velocities).all(|v| v.is_finite());
        if [positions.len(), velocities.len()] != [count; 2] || !finite {
            return Err(Error::Input(format!(
                "got {} positions and {} velocities for {count} nodes with prescribed motion; give a finite one of each per node",
                positions.len(),
                velocities.len()
            )));
        }
        let motion = &mut self.prescribed_motions[id.0];
        let positions: Vec<[f64; 3]> = positions.iter().map(|p| p.to_array()).collect();
        let velocities: Vec<[f64; 3]> = velocities.iter().map(|v| v.to_array()).collect();
        if (&motion.positions, &motion.velocities) != (&positions, &velocities) {
            (motion.positions, motion.velocities) = (positions, velocities);
            self.versions.grabs += 1;
            self.versions.any += 1;
        }
        Ok(())
    }

    pub(in crate::physics) fn prescribed_motions(&self) -> &[PrescribedMotion] {
        &self.prescribed_motions
    }
}
