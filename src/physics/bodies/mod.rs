//! Several bodies as one simulator: each body has its own simulator, and all are drawn in one
//! picture.

mod merged_mesh;
mod node_scatter;
mod simulator;

use super::loads::{LoadVersions, LoadsState};
use super::{GrabId, Loads, Member, NodePositions, Simulator, SimulatorState};
use crate::gpu::Gpu;
use crate::{Error, Result};
use glam::DVec3;
use merged_mesh::{MergedMesh, MeshRef};
use node_scatter::NodeScatterPass;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Several bodies, each with its own material, scheme and engine, as one [`Simulator`].
///
/// Its mesh is the concatenation of theirs (see
/// [`TetMesh::merge_meshes`](crate::mesh::TetMesh::merge_meshes)). A step is one or several
/// substeps of each body, so stiff bodies do not slow down soft ones. The bodies do not interact.
/// Loads act on each body: gravity on all, pins and forces by node number, grabs and cuts by
/// position. The progress counts the steps of the body that has completed the fewest.
pub struct MultiBody {
    gpu: Gpu,
    members: Vec<Member>,
    whole: MergedMesh,
    masses: Vec<f64>,
    nodes: NodePositions,
    places: Vec<NodeScatterPass>,
    loads: Loads,
    /// The loads that the members have.
    synced_loads: LoadVersions,
    gravity: DVec3,
    pinned: Vec<bool>,
    /// For each grab, the member grabs it consists of.
    grabs: BTreeMap<GrabId, Vec<(usize, GrabId)>>,
    next_grab: u32,
}

/// The state of [`MultiBody`]: see [`Checkpointing::state`](crate::physics::Checkpointing::state).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BodiesState {
    members: Vec<SimulatorState>,
    loads: LoadsState,
    handed: LoadVersions,
    gravity: [f64; 3],
    handed_pins: Vec<bool>,
    grabs: BTreeMap<GrabId, Vec<(usize, GrabId)>>,
    next_grab: u32,
}

impl MultiBody {
    /// Combines `members`, whose meshes must have the same unit.
    ///
    /// # Errors
    /// [`Error::Input`] if there are no members, a step is not positive, or meshes have different
    /// units; [`Error::Gpu`] if all nodes together do not fit the device.
    pub fn new(gpu: &Gpu, members: Vec<Member>) -> Result<MultiBody> {
        let Some(first) = members.first() else {
            return Err(Error::Input(
                "no bodies to simulate; give at least one".into(),
            ));
        };
        if let Some(m) = members.iter().find(|m| m.step.is_nan() || m.step <= 0.0) {
            return Err(Error::Input(format!(
                "body \"{}\": time step must be positive, got {} s",
                m.name, m.step
            )));
        }
        let length_unit = first.simulator.loads().length_unit();
        let gravity = first.simulator.loads().gravity();
        let parts = members.iter();
        let parts: Vec<_> = parts
            .map(|m| (m.name.clone(), m.simulator.mesh()))
            .collect();
        let whole = MergedMesh::new(&parts)?;
        let nodes = NodePositions::new(gpu, &whole.mesh)?;
        let mut loads = Loads::new(whole.mesh.nodes.len(), nodes.frame(), length_unit);
        loads.set_gravity(gravity);
        let (mut pinned, mut forces) = (Vec::new(), vec![DVec3::ZERO; whole.mesh.nodes.len()]);
        for (member, places) in members.iter().zip(&whole.node_map) {
            let own = member.simulator.loads();
            // For a mesh embedded in a cage, these are the nodes of the cage.
            if own.pinned().len() == places.len() && member.simulator.coarse_body().is_none() {
                let of_nodes = places.iter().zip(own.pinned()).zip(own.forces());
                for ((v, is), force) in of_nodes {
                    forces[*v as usize] = *force;
                    if *is {
                        pinned.push(*v);
                    }
                }
            }
        }
        loads.pin_nodes(&pinned)?;
        loads.set_forces(&forces)?;
        let mut bodies = MultiBody {
            gpu: gpu.clone(),
            masses: Vec::new(),
            places: Vec::new(),
            synced_loads: loads.versions,
            pinned: loads.pinned().to_vec(),
            gravity,
            loads,
            members,
            whole,
            nodes,
            grabs: BTreeMap::new(),
            next_grab: 0,
        };
        bodies.rebuild_index()?;
        Ok(bodies)
    }

    /// Rebuilds the masses of all nodes and the passes that scatter each body's nodes to the whole.
    fn rebuild_index(&mut self) -> Result<()> {
        self.masses = vec![0.0; self.whole.mesh.nodes.len()];
        self.places.clear();
        for (member, places) in self.members.iter().zip(&self.whole.node_map) {
            let simulator = member.simulator.as_ref();
            let place = NodeScatterPass::new(&self.gpu, simulator.nodes(), places, &self.nodes)?;
            self.places.push(place);
            // The masses of a cage are not those of the embedded mesh.
            if simulator.coarse_body().is_none() {
                for (v, mass) in places.iter().zip(simulator.masses()) {
                    self.masses[*v as usize] = *mass;
                }
            }
        }
        Ok(())
    }

    /// Passes changed loads on to each body.
    fn sync_loads(&mut self) -> Result<()> {
        let versions = self.loads.versions;
        if versions == self.synced_loads {
            return Ok(());
        }
        let gravity = self.loads.gravity();
        if gravity != self.gravity {
            for member in &mut self.members {
                member.simulator.loads_mut().set_gravity(gravity);
            }
            self.gravity = gravity;
        }
        if versions.forces != self.synced_loads.forces {
            for (member, places) in self.members.iter_mut().zip(&self.whole.node_map) {
                let forces = member_values(self.loads.forces(), places);
                member.named(|s| s.set_forces(&forces))?;
            }
        }
        if versions.constraints != self.synced_loads.constraints {
            let pinned = self.loads.pinned();
            let let_go = self.pinned.iter().zip(pinned).any(|(was, is)| *was && !is);
            for (member, places) in self.members.iter_mut().zip(&self.whole.node_map) {
                if let_go {
                    member.simulator.loads_mut().unpin_all();
                }
                let own = (0u32..).zip(places).filter(|(_, v)| pinned[**v as usize]);
                let own: Vec<u32> = own.map(|(i, _)| i).collect();
                if !own.is_empty() {
                    member.named(|s| s.pin_nodes(&own))?;
                }
            }
            self.pinned = pinned.to_vec();
        }
        self.synced_loads = versions;
        Ok(())
    }

    /// Gathers per-node vectors of all bodies.
    fn gather(&self, of: impl Fn(&dyn Simulator) -> Result<Vec<DVec3>>) -> Result<Vec<DVec3>> {
        let mut all = vec![DVec3::ZERO; self.whole.mesh.nodes.len()];
        for (member, places) in self.members.iter().zip(&self.whole.node_map) {
            let own = of(member.simulator.as_ref()).map_err(|e| member.name_error(e))?;
            for (v, own) in places.iter().zip(own) {
                all[*v as usize] = own;
            }
        }
        Ok(all)
    }

    /// Scatters per-node vectors of the whole to the bodies.
    fn scatter(
        &mut self,
        what: &str,
        vectors: &[DVec3],
        put: impl Fn(&mut dyn Simulator, &[DVec3]) -> Result<()>,
    ) -> Result<()> {
        let count = self.whole.mesh.nodes.len();
        if vectors.len() != count {
            return Err(Error::Input(format!(
                "got {} {what} for {count} nodes; give one per node",
                vectors.len()
            )));
        }
        for (member, places) in self.members.iter_mut().zip(&self.whole.node_map) {
            let own = member_values(vectors, places);
            member.named(|s| put(s, &own))?;
        }
        Ok(())
    }

    /// Each body's mesh and topology after cuts.
    fn parts(members: &[Member]) -> Vec<MeshRef<'_>> {
        let parts = members.iter().map(|m| m.simulator.as_ref());
        parts.map(|s| (s.mesh(), s.topology())).collect()
    }
}

/// Returns a body's values from those of all nodes.
fn member_values(all: &[DVec3], places: &[u32]) -> Vec<DVec3> {
    places.iter().map(|v| all[*v as usize]).collect()
}
