//! `shaders/gpu/scan_marks.wgsl`: what is marked to be drawn, counted in order.

crate::gpu_struct! {
    /// Its parameters.
    pub(crate) struct BitmaskPrefixSum {
        /// Words of marks: 32 things each.
        pub runs: u32,
    }
}
