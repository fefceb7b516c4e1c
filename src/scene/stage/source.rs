//! Where the node positions of a stage come from.

use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::{Field, TetMesh, Topology};
use crate::physics::NodePositions;
use crate::scene::Motion;
use glam::DVec3;

/// Source of the node positions.
pub(in crate::scene) enum NodeSource {
    /// Static, or set by the caller pose by pose.
    Posed(Box<StaticMesh>),
    /// A simulator.
    Simulated(Box<Motion>),
}

/// A mesh that is moved by the caller only.
pub(in crate::scene) struct StaticMesh {
    mesh: TetMesh,
    topology: Topology,
    pub(super) nodes: NodePositions,
}

impl StaticMesh {
    /// Sets the node positions and fields.
    pub(super) fn show(&mut self, nodes: &[DVec3], fields: &[Field]) -> Result<()> {
        let before = std::mem::take(&mut self.mesh.fields);
        let taken = fields
            .iter()
            .try_for_each(|f| self.mesh.set_field(f.clone()));
        let put = taken.and_then(|()| self.nodes.set_positions(nodes));
        if put.is_err() {
            self.mesh.fields = before;
        }
        put
    }
}

impl NodeSource {
    /// Creates a source for `mesh`, which only the caller moves.
    pub fn posed(gpu: &Gpu, mesh: TetMesh) -> Result<NodeSource> {
        Ok(NodeSource::Posed(Box::new(StaticMesh {
            topology: Topology::new(&mesh),
            nodes: NodePositions::new(gpu, &mesh)?,
            mesh,
        })))
    }

    pub fn nodes(&self) -> &NodePositions {
        match self {
            NodeSource::Posed(posed) => &posed.nodes,
            NodeSource::Simulated(motion) => motion.simulator.nodes(),
        }
    }

    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        match self {
            NodeSource::Posed(posed) => &posed.mesh,
            NodeSource::Simulated(motion) => motion.simulator.mesh(),
        }
    }

    /// Returns the topology of the mesh.
    pub fn topology(&self) -> &Topology {
        match self {
            NodeSource::Posed(posed) => &posed.topology,
            NodeSource::Simulated(motion) => motion.simulator.topology(),
        }
    }
}
