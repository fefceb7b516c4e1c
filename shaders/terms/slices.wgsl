// Pre-integration table in slices of mean colour and mean extinction, one per quarter octave of
// depth; both axes are scalars. Needs `params: View` of the importing shader.
//
// Slices are layers of one array; depths are lengths times the largest extinction, times log2(e).
#term table

// 2^OCTAVE_BITS slices per octave of depth, the first octave beginning at 2^FIRST_OCTAVE; the last
// slice is used for all deeper segments.
const OCTAVE_BITS: u32 = 2u;
const FIRST_OCTAVE: i32 = -5;

@group(0) @binding(next) var table: texture_2d_array<f32>;
@group(0) @binding(next) var smooth_sampler: sampler;

// Returns the premultiplied colour and opacity of a segment between table coordinates s0 (front)
// and s1. There is only one transfer function, so `row` is ignored.
fn segment(s0: f32, s1: f32, depth: f32, row: u32) -> vec4<f32> {
    // The upper bits of a float approximate its logarithm, linearly between powers of two.
    let bin = i32(bitcast<u32>(depth) >> (23u - OCTAVE_BITS)) - ((127 + FIRST_OCTAVE) << OCTAVE_BITS);
    let slice = clamp(bin, 0, i32(params.layers) - 1);
    let mean = textureSampleLevel(table, smooth_sampler, vec2(s0, s1), slice, 0.0);
    let alpha = 1.0 - exp2(-mean.a * depth);
    return vec4(mean.rgb * alpha, alpha);
}
