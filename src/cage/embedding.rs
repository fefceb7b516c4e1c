//! The fine mesh's nodes on the GPU, carried by the tets of a coarse one.

use crate::Result;
use crate::gpu::{Gpu, Pass, Recorder, Texel};
use crate::mesh::{BarycentricMap, TetMesh};
use crate::physics::NodePositions;
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/cage/carry.wgsl`.
        pub struct Carry {
            pub to_fine: [f32; 4],
            pub nodes: u32,
            pub _pad: [u32; 3],
        }
    }
}

/// Weights below this are those of a node outside.
const OUTSIDE: f64 = -1e-6;

/// Nodes of a fine mesh, each tied by barycentric weights to the tet of a coarse mesh that holds
/// it, or to the nearest one.
///
/// One pass writes their positions, which whoever draws the fine mesh takes. Affine motions of
/// the coarse mesh carry the fine one exactly.
#[derive(Debug)]
pub struct Embedding {
    transfer: BarycentricMap,
    nodes: NodePositions,
    pass: Pass,
    /// The version of the coarse nodes that the positions were made from.
    carried: u64,
    outside: usize,
}

impl Embedding {
    /// Embeds the nodes of `fine` in the tets of `coarse`, both at rest and in the same unit.
    /// `carriers` are the coarse mesh's nodes on the GPU.
    ///
    /// # Errors
    /// As [`BarycentricMap::new`]; [`Error::Gpu`](crate::Error::Gpu) when the nodes do not fit the
    /// device.
    pub fn new(
        gpu: &Gpu,
        coarse: &TetMesh,
        carriers: &NodePositions,
        fine: &TetMesh,
    ) -> Result<Embedding> {
        let transfer = BarycentricMap::new(coarse, &fine.nodes)?;
        Embedding::with_transfer(gpu, transfer, carriers, fine)
    }

    /// As [`Embedding::new`], where it is known what carries what.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the nodes do not fit the device.
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
        let corners = gpu.array_of("corners that carry", Texel::U32x4, &of_nodes)?;
        let weights = gpu.array_of("weights of corners", Texel::F32x4, &weights)?;
        let pass = gpu
            .pass("cage/carry")
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

    /// The fine mesh's nodes, for drawing, as of the last [`Embedding::record_update`].
    pub fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    /// Fine nodes outside the coarse mesh, whose weights reach beyond 0 and 1.
    pub fn outside(&self) -> usize {
        self.outside
    }

    /// What carries each fine node.
    pub fn transfer(&self) -> &BarycentricMap {
        &self.transfer
    }

    /// Records the carrying of the fine nodes, if `carriers`, the nodes it was made with, may have
    /// moved since the last time. Whether that is so.
    pub fn record_update(&mut self, work: &mut Recorder, carriers: &NodePositions) -> bool {
        let moved = self.carried != carriers.version();
        if moved {
            self.carried = carriers.version();
            self.pass.record(work);
        }
        moved
    }

    /// Positions, or other vectors, of the fine nodes, of those of the coarse ones; in float64.
    ///
    /// # Errors
    /// As [`BarycentricMap::apply`].
    pub fn interpolate(&self, coarse: &[DVec3]) -> Result<Vec<DVec3>> {
        self.transfer.apply(coarse)
    }
}
