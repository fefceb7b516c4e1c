//! Lists of grabbed nodes on the GPU.
//!
//! A target is constant within a recording of steps; a caller that moves it fast should record few
//! steps at a time.

use crate::Result;
use crate::gpu::{Array, Gpu, Pass, Texel};
use crate::physics::Loads;
use crate::physics::loads::grab::GrabMode;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/prescribed_positions.wgsl`.
        pub struct PrescribedPositionsParams {
            pub count: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/grab_springs.wgsl`.
        pub struct GrabSpringParams {
            pub count: u32,
        }
    }
}

/// The lists, valid for one version of the loads.
#[derive(Debug, Default)]
pub(in crate::physics) struct GrabLists {
    /// Versions of grabs and forces.
    pub source_versions: [u64; 2],
    prescribed: Option<[Array; 2]>,
    grab_springs: Option<[Array; 3]>,
}

impl GrabLists {
    /// The lists of `loads`; `w` is the fourth component of each node's position.
    pub fn new(gpu: &Gpu, loads: &Loads, w: impl Fn(usize) -> f32) -> Result<GrabLists> {
        let frame = loads.frame();
        let length = frame.scale * loads.length_unit();
        let (mut prescribed, mut prescribed_targets) = (Vec::new(), Vec::new());
        let (mut grab_springs, mut targets, mut forces) = (Vec::new(), Vec::new(), Vec::new());
        for grab in loads.grabs.iter() {
            for (i, offset) in grab.nodes.iter().zip(&grab.offsets) {
                let target_position = frame.to_local(grab.target + *offset);
                match grab.grip {
                    GrabMode::Follow => {
                        prescribed.push(*i);
                        prescribed_targets.push(target_position.extend(w(*i as usize)).to_array());
                    }
                    GrabMode::Spring { stiffness, limit } => {
                        let node_count = grab.nodes.len() as f64;
                        let force = loads.forces()[*i as usize].as_vec3();
                        grab_springs.push(*i);
                        let spring_stiffness = (stiffness / node_count * length) as f32;
                        targets.push(target_position.extend(spring_stiffness).to_array());
                        forces.push(force.extend((limit / node_count) as f32).to_array());
                    }
                }
            }
        }
        let versions = loads.versions;
        Ok(GrabLists {
            source_versions: [versions.grabs, versions.forces],
            prescribed: match prescribed.is_empty() {
                true => None,
                false => Some([
                    gpu.array_of("constrained nodes", Texel::U32, &prescribed)?,
                    gpu.array_of(
                        "positions of constrained nodes",
                        Texel::F32x4,
                        &prescribed_targets,
                    )?,
                ]),
            },
            grab_springs: match grab_springs.is_empty() {
                true => None,
                false => Some([
                    gpu.array_of("target spring nodes", Texel::U32, &grab_springs)?,
                    gpu.array_of("target spring positions", Texel::F32x4, &targets)?,
                    gpu.array_of("target spring loads", Texel::F32x4, &forces)?,
                ]),
            },
        })
    }

    /// Whether there are spring grabs.
    pub fn has_springs(&self) -> bool {
        self.grab_springs.is_some()
    }

    /// The pass that sets followed nodes to their targets.
    pub fn prescribed_positions_pass(&self, gpu: &Gpu, positions: &Array) -> Result<Option<Pass>> {
        let Some([node_indices, prescribed_targets]) = &self.prescribed else {
            return Ok(None);
        };
        let pass = gpu
            .pass("physics/prescribed_positions")
            .read(node_indices)
            .read(prescribed_targets)
            .write(positions)
            .params(&gpu_data::PrescribedPositionsParams {
                count: node_indices.len(),
            })
            .dispatch_items(node_indices.len())?;
        Ok(Some(pass))
    }

    /// The pass that adds the spring forces at `positions` to the external forces.
    pub fn grab_springs_pass(
        &self,
        gpu: &Gpu,
        positions: &Array,
        external: &Array,
    ) -> Result<Option<Pass>> {
        let Some([node_indices, targets, loads]) = &self.grab_springs else {
            return Ok(None);
        };
        let pass = gpu
            .pass("physics/grab_springs")
            .read(positions)
            .read(node_indices)
            .read(targets)
            .read(loads)
            .write(external)
            .params(&gpu_data::GrabSpringParams {
                count: node_indices.len(),
            })
            .dispatch_items(node_indices.len())?;
        Ok(Some(pass))
    }
}
