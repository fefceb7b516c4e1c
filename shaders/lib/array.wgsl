// One-dimensional arrays held in two-dimensional textures, and one-dimensional work folded into
// two-dimensional dispatches. The twin of `gpu::Array` (ROW) and `gpu::Pass` (folding).

const ROW_BITS: u32 = 13u;

// Items a workgroup; a pass may set it.
override WORKGROUP: u32 = 64u;

// The texel that holds item i.
fn array_texel(i: u32) -> vec2<u32> {
    return vec2<u32>(i & ((1u << ROW_BITS) - 1u), i >> ROW_BITS);
}

// The item an invocation works on: global_invocation_id and num_workgroups, unfolded.
fn invocation_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
