// Returns the vertices of one triangle that covers the target; its depth is 0, the farthest.

fn fullscreen(i: u32) -> vec4<f32> {
    return vec4(f32((i << 1u) & 2u) * 2.0 - 1.0, f32(i & 2u) * 2.0 - 1.0, 0.0, 1.0);
}
