//! A GPU pass that scatters the nodes of one body to their positions among those of several.

use crate::Result;
use crate::gpu::{Gpu, Pass, Recorder, Texel};
use crate::physics::NodePositions;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/node_scatter.wgsl`.
        pub struct Place {
            pub to_whole: [f32; 4],
            pub nodes: u32,
            pub _pad: [u32; 3],
        }
    }
}

/// Scatters one body's nodes to those of all bodies.
#[derive(Debug)]
pub(super) struct NodeScatterPass {
    pass: Pass,
    /// Version of the body's nodes at the last scatter.
    scattered_version: Option<u64>,
}

impl NodeScatterPass {
    /// Scatters node i of `body` to item `places[i]` of `whole`.
    pub fn new(
        gpu: &Gpu,
        body: &NodePositions,
        places: &[u32],
        whole: &NodePositions,
    ) -> Result<NodeScatterPass> {
        let (from, to) = (body.frame(), whole.frame());
        let shift = ((from.origin - to.origin) / to.scale).as_vec3();
        let params = gpu_data::Place {
            to_whole: shift.extend((from.scale / to.scale) as f32).to_array(),
            nodes: places.len() as u32,
            _pad: [0; 3],
        };
        let places = gpu.array_of("node indices of a body", Texel::U32, places)?;
        let pass = gpu
            .pass("physics/node_scatter")
            .read(body.array())
            .read(&places)
            .write(whole.array())
            .params(&params)
            .dispatch_items(params.nodes)?;
        Ok(NodeScatterPass {
            pass,
            scattered_version: None,
        })
    }

    /// Records the scatter of `body`, the nodes it was created with, if they may have moved.
    pub fn record(&mut self, work: &mut Recorder, body: &NodePositions) {
        let version = Some(body.version());
        if self.scattered_version != version {
            self.scattered_version = version;
            self.pass.record(work);
        }
    }
}
