//! Embeds the nodes of a fine mesh in the tetrahedra of a coarse one, on the GPU.

use crate::Result;
use crate::gpu::{Gpu, Pass, Recorder, Texel};
use crate::mesh::{BarycentricMap, TetMesh};
use crate::physics::NodePositions;
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/cage/embedding.wgsl`.
        pub struct Carry {
            pub to_fine: [f32; 4],
            pub nodes: u32,
            pub _pad: [u32; 3],
        }
    }
}

/// Weights below this mark a node outside of the coarse mesh.
const OUTSIDE: f64 = -1e-6;

/// Nodes of a fine mesh, each embedded by barycentric weights in the tetrahedron of a coarse mesh
/// that contains it, or in the nearest one.
///
/// One pass computes their positions for rendering. Affine motions of the coarse mesh are
/// reproduced exactly.
#[derive(Debug)]
pub struct Embedding {
    transfer: BarycentricMap,
    nodes: NodePositions,
    pass: Pass,
    /// Version of the coarse nodes at the last update.
    carried: u64,
    outside: usize,
}

impl Embedding {
    /// Embeds the nodes of `fine` in the tetrahedra of `coarse`, both at rest and in the same unit.
    /// `carriers` are the coarse mesh's nodes on the GPU.
    ///
    /// # Errors
    /// As [`BarycentricMap::new`]; [`Error::Gpu`](crate::Error::Gpu) if the device cannot allocate
    /// the nodes.
    pub fn new(
        gpu: &Gpu,
        coarse: &TetMesh,
        carriers: &NodePositions,
        fine: &TetMesh,
    ) -> Result<Embedding> {
        let transfer = BarycentricMap::new(coarse, &fine.nodes)?;
        Embedding::with_transfer(gpu, transfer, carriers, fine)
    }

    /// As [`Embedding::new`], with known weights.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) if the device cannot allocate the nodes.
    pub fn with_transfer(
        gpu: &Gpu,
        transfer: BarycentricMap,
        carriers: &NodePositions,
        fine: &TetMesh,
    ) -> Result<Embedding> {
        let nodes = NodePositions::new(gpu, fine)?;
        let (from, to) = (carriers.frame(), nodes.frame());
        let shift = ((from.origin - to.origin) / to.scale).as_vec3();
        let params = gpu_data::Carry {
            to_fine: shift.extend((from.scale / to.scale) as f32).to_array(),
            nodes: nodes.len() as u32,
            _pad: [0; 3],
        };
        let shares = transfer.source_weights();
        let of_nodes: Vec<[u32; 4]> = shares.iter().map(|s| s.0).collect();
        let weights: Vec<[f32; 4]> = shares.iter().map(|s| s.1.map(|w| w as f32)).collect();
        let outside = |s: &&([u32; 4], [f64; 4])| s.1.iter().any(|w| *w < OUTSIDE);
        let outside = shares.iter().filter(outside).count();
        let corners = gpu.array_of("embedding nodes", Texel::U32x4, &of_nodes)?;
        let weights = gpu.array_of("embedding weights", Texel::F32x4, &weights)?;
        let pass = gpu
            .pass("cage/embedding")
            .read(carriers.array())
            .read(&corners)
            .read(&weights)
            .write(nodes.array())
            .params(&params)
            .dispatch_items(nodes.len() as u32)?;
        Ok(Embedding {
            transfer,
            nodes,
            pass,
            carried: carriers.version(),
            outside,
        })
    }

    /// Returns the fine mesh's nodes for rendering, as of the last [`Embedding::record_update`].
    pub fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    /// Makes the next [`Embedding::record_update`] update the nodes in any case.
    pub(crate) fn invalidate(&mut self) {
        self.carried = u64::MAX;
    }

    /// Returns the number of fine nodes outside of the coarse mesh, whose weights are not all from
    /// 0 to 1.
    pub fn outside(&self) -> usize {
        self.outside
    }

    /// Returns the barycentric weights of the fine nodes.
    pub fn transfer(&self) -> &BarycentricMap {
        &self.transfer
    }

    /// Records the update of the fine nodes if `carriers`, the nodes passed at creation, changed
    /// since the last update. Returns whether they did.
    pub fn record_update(&mut self, work: &mut Recorder, carriers: &NodePositions) -> bool {
        let moved = self.carried != carriers.version();
        if moved {
            self.carried = carriers.version();
            self.pass.record(work);
        }
        moved
    }

    /// Interpolates positions, or other vectors, from coarse nodes to fine ones, in float64.
    ///
    /// # Errors
    /// As [`BarycentricMap::apply`].
    pub fn interpolate(&self, coarse: &[DVec3]) -> Result<Vec<DVec3>> {
        self.transfer.apply(coarse)
    }
}
