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
        pub struct HoldParams {
            pub count: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/grab_springs.wgsl`.
        pub struct DrawParams {
            pub count: u32,
        }
    }
}

/// The lists, valid for one version of the loads.
#[derive(Debug, Default)]
pub(in crate::physics) struct GrabLists {
    /// Versions of grabs and forces.
    pub source_versions: [u64; 2],
    held: Option<[Array; 2]>,
    drawn: Option<[Array; 3]>,
}

impl GrabLists {
    /// The lists of `loads`; `w` is the fourth component of each node's position.
    pub fn new(gpu: &Gpu, loads: &Loads, w: impl Fn(usize) -> f32) -> Result<GrabLists> {
        let frame = loads.frame();
        let length = frame.scale * loads.length_unit();
        let (mut held, mut places) = (Vec::new(), Vec::new());
        let (mut drawn, mut targets, mut forces) = (Vec::new(), Vec::new(), Vec::new());
        for grab in loads.grabs.iter() {
            for (i, offset) in grab.nodes.iter().zip(&grab.offsets) {
                let place = frame.to_local(grab.target + *offset);
                match grab.grip {
                    GrabMode::Follow => {
                        held.push(*i);
                        places.push(place.extend(w(*i as usize)).to_array());
                    }
                    GrabMode::Spring { stiffness, limit } => {
                        let share = grab.nodes.len() as f64;
                        let force = loads.forces()[*i as usize].as_vec3();
                        drawn.push(*i);
                        let pull = (stiffness / share * length) as f32;
                        targets.push(place.extend(pull).to_array());
                        forces.push(force.extend((limit / share) as f32).to_array());
                    }
                }
            }
        }
        let versions = loads.versions;
        Ok(GrabLists {
            source_versions: [versions.grabs, versions.forces],
            held: match held.is_empty() {
                true => None,
                false => Some([
                    gpu.array_of("constrained nodes", Texel::U32, &held)?,
                    gpu.array_of("positions of constrained nodes", Texel::F32x4, &places)?,
                ]),
            },
            drawn: match drawn.is_empty() {
                true => None,
                false => Some([
                    gpu.array_of("target spring nodes", Texel::U32, &drawn)?,
                    gpu.array_of("target spring positions", Texel::F32x4, &targets)?,
                    gpu.array_of("target spring loads", Texel::F32x4, &forces)?,
                ]),
            },
        })
    }

    /// Whether there are spring grabs.
    pub fn has_springs(&self) -> bool {
        self.drawn.is_some()
    }

    /// The pass that sets followed nodes to their targets.
    pub fn hold_pass(&self, gpu: &Gpu, positions: &Array) -> Result<Option<Pass>> {
        let Some([numbers, places]) = &self.held else {
            return Ok(None);
        };
        let pass = gpu
            .pass("physics/prescribed_positions")
            .read(numbers)
            .read(places)
            .write(positions)
            .params(&gpu_data::HoldParams {
                count: numbers.len(),
            })
            .dispatch_items(numbers.len())?;
        Ok(Some(pass))
    }

    /// The pass that adds the spring forces at `positions` to the external forces.
    pub fn draw_pass(
        &self,
        gpu: &Gpu,
        positions: &Array,
        external: &Array,
    ) -> Result<Option<Pass>> {
        let Some([numbers, targets, loads]) = &self.drawn else {
            return Ok(None);
        };
        let pass = gpu
            .pass("physics/grab_springs")
            .read(positions)
            .read(numbers)
            .read(targets)
            .read(loads)
            .write(external)
            .params(&gpu_data::DrawParams {
                count: numbers.len(),
            })
            .dispatch_items(numbers.len())?;
        Ok(Some(pass))
    }
}
