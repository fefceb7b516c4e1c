//! The pass that moves the nodes in explicit schemes; the CPU side of
//! `shaders/lib/explicit_state.wgsl`.

use super::step_resources::StepResources;
use crate::Result;
use crate::gpu::{Array, Pass};
use crate::physics::GpuBody;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/lib/explicit_state.wgsl`.
        pub struct MoveParams {
            pub nodes: u32,
            pub dt: f32,
            pub kick: f32,
            pub _pad0: u32,
        }
    }
}
use gpu_data::MoveParams;

/// Builds the pass `shader`, from the state of `body` to the candidate positions and to
/// `velocities`.
pub(in crate::physics) fn explicit_pass(
    core: &StepResources,
    body: &GpuBody,
    shader: &str,
    velocities: &Array,
    dt: f32,
    kick: f32,
) -> Result<Pass> {
    let params = MoveParams {
        nodes: core.nodes,
        dt,
        kick,
        _pad0: 0,
    };
    core.gpu
        .pass(shader)
        .read(body.nodes().array())
        .read(&body.velocities)
        .read(&core.forces)
        .read(&body.masses)
        .read(&core.status)
        .write(&core.next_positions)
        .write(velocities)
        .params(&params)
        .dispatch_items(core.nodes)
}
