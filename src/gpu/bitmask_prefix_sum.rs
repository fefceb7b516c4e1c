//! Parameters of `shaders/gpu/bitmask_prefix_sum.wgsl`: prefix sum over a bit mask, for stream
//! compaction in order.

crate::gpu_struct! {
    /// Parameters of the shader.
    pub(crate) struct BitmaskPrefixSum {
        /// Number of mask words, 32 bits each.
        pub runs: u32,
    }
}
