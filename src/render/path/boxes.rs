//! The tree of boxes around the boundary faces, with which a ray outside finds where it enters the
//! body (`shaders/lib/path_boxes.wgsl`).
//!
//! A complete binary tree over the faces in their stored order, which is a Morton order at rest; it
//! keeps its form when the body moves, and only its boxes are computed anew.

use crate::Result;
use crate::gpu::{Array, Gpu, Pass, Recorder, Texel};
use crate::render::Geometry;

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path_leaves.wgsl`.
        pub(super) struct Leaves {
            pub faces: u32,
            pub leaves: u32,
        }
    }
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path_boxes.wgsl`.
        pub(super) struct Level {
            pub first: u32,
        }
    }
}

/// Faces per leaf; as in `lib/path_boxes`.
const LEAF_FACES: u32 = 4;

pub(super) struct BoxTree {
    /// Two corners per node; node 1 is the root.
    pub boxes: Array,
    /// Three items per face.
    pub faces: Array,
    pub leaves: u32,
    /// The leaves, then level by level to the root.
    passes: Vec<Pass>,
    /// What the passes compute, to be copied to `boxes`.
    computed: wgpu::Buffer,
}

impl BoxTree {
    pub fn new(gpu: &Gpu, geometry: &Geometry) -> Result<BoxTree> {
        let faces = geometry.boundary.len();
        let leaves = faces.div_ceil(LEAF_FACES).max(1).next_power_of_two();
        let boxes = gpu.array("boxes around faces", Texel::F32x4, 4 * leaves as usize)?;
        let placed = gpu.array(
            "boundary faces",
            Texel::F32x4,
            (3 * LEAF_FACES * leaves) as usize,
        )?;
        let computed = gpu.buffer("boxes around faces", 16 * u64::from(boxes.capacity()))?;
        let mut passes = vec![
            gpu.pass("render/path_leaves")
                .read(&geometry.positions)
                .read(&geometry.boundary)
                .write(&computed)
                .write(&placed)
                .params(&gpu_data::Leaves { faces, leaves })
                .dispatch_items(leaves)?,
        ];
        let mut first = leaves / 2;
        while first > 0 {
            passes.push(
                gpu.pass("render/path_boxes")
                    .write(&computed)
                    .params(&gpu_data::Level { first })
                    .dispatch_items(first)?,
            );
            first /= 2;
        }
        Ok(BoxTree {
            boxes,
            faces: placed,
            leaves,
            passes,
            computed,
        })
    }

    /// Records the computation of faces and boxes at the current positions.
    pub fn record(&self, work: &mut Recorder) {
        self.passes.iter().for_each(|pass| pass.record(work));
        self.boxes.copy_from(&self.computed, work);
    }
}
