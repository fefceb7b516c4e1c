// One-dimensional arrays stored in two-dimensional textures, and one-dimensional work folded into
// two-dimensional dispatches. Matches `gpu::Array` (row length) and `gpu::Pass` (folding).

const ROW_BITS: u32 = 13u;

// Invocations per workgroup; a pass may override it.
override WORKGROUP: u32 = 64u;

// Returns the texel that stores item i.
fn array_texel(i: u32) -> vec2<u32> {
    return vec2<u32>(i & ((1u << ROW_BITS) - 1u), i >> ROW_BITS);
}

// Returns the item index of an invocation from global_invocation_id and num_workgroups.
fn invocation_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
