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
    places: Vec<[f64; 3]>,
    velocities: Vec<[f64; 3]>,
}

impl PrescribedMotion {
    /// Each node with its position and velocity, in file units.
    pub fn iter(&self) -> impl Iterator<Item = (u32, DVec3, DVec3)> {
        let ways = self.places.iter().zip(&self.velocities);
        let nodes = self.nodes.iter().zip(ways);
        nodes.map(|(v, (x, w))| (*v, DVec3::from(*x), DVec3::from(*w)))
    }

    /// Its nodes.
    pub(super) fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Whether it is a state of the nodes of `other`.
    pub(super) fn fits(&self, other: &PrescribedMotion) -> bool {
        self.nodes == other.nodes
            && [self.places.len(), self.velocities.len()] == [self.nodes.len(); 2]
    }

    /// Updates it after a cut: duplicated nodes move as their originals.
    pub(super) fn apply_cut(&mut self, cut: &TetCut) {
        for [new, old] in &cut.duplicated_nodes {
            if let Some(k) = self.nodes.iter().position(|v| v == old) {
                self.nodes.push(*new);
                self.places.push(self.places[k]);
                self.velocities.push(self.velocities[k]);
            }
        }
    }
}

impl Loads {
    /// Prescribes the motion of `nodes`, which are at `places` (file units), from now on. The
    /// engine must support it:
    /// [`Simulator::add_prescribed_motion`](crate::physics::Simulator::add_prescribed_motion).
    pub(in crate::physics) fn add_prescribed_motion(
        &mut self,
        nodes: &[u32],
        places: &[DVec3],
    ) -> Result<PrescribedMotionId> {
        let held = self.constrained_nodes();
        if let Some(v) = nodes
            .iter()
            .find(|v| held.get(**v as usize) != Some(&false))
        {
            return Err(Error::Input(format!(
                "cannot prescribe the motion of node {v}: it is pinned, grabbed or already prescribed, or does not exist; remove one of its constraints"
            )));
        }
        if nodes.is_empty() || nodes.len() != places.len() {
            return Err(Error::Input(format!(
                "got {} positions for {} nodes with prescribed motion; give one per node, and at least one node",
                places.len(),
                nodes.len()
            )));
        }
        self.led.push(PrescribedMotion {
            nodes: nodes.to_vec(),
            places: places.iter().map(|p| p.to_array()).collect(),
            velocities: vec![[0.0; 3]; nodes.len()],
        });
        self.grabs_changed();
        Ok(PrescribedMotionId(self.led.len() - 1))
    }

    /// Sets the positions `places` (file units) of nodes with prescribed motion, and the
    /// `velocities` (file units per second) at which they continue until the next call.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of values is wrong or one is not finite.
    pub fn set_prescribed_motion(
        &mut self,
        id: PrescribedMotionId,
        places: &[DVec3],
        velocities: &[DVec3],
    ) -> Result<()> {
        let count = self.led.get(id.0).map_or(0, |led| led.nodes.len());
        let finite = places.iter().chain(velocities).all(|v| v.is_finite());
        if [places.len(), velocities.len()] != [count; 2] || !finite {
            return Err(Error::Input(format!(
                "got {} positions and {} velocities for {count} nodes with prescribed motion; give a finite one of each per node",
                places.len(),
                velocities.len()
            )));
        }
        let led = &mut self.led[id.0];
        let places: Vec<[f64; 3]> = places.iter().map(|p| p.to_array()).collect();
        let velocities: Vec<[f64; 3]> = velocities.iter().map(|v| v.to_array()).collect();
        if (&led.places, &led.velocities) != (&places, &velocities) {
            (led.places, led.velocities) = (places, velocities);
            self.versions.grabs += 1;
            self.versions.any += 1;
        }
        Ok(())
    }

    pub(in crate::physics) fn prescribed_motions(&self) -> &[PrescribedMotion] {
        &self.led
    }
}
