// Pre-integration table of the paper: colour and opacity of segments in a volume whose third axis
// is depth, stored as the layers of one array. Needs `params: View` of the importing shader.
//
// Depths are lengths times the largest extinction, times log2(e).
#term table

// Segments deeper than params.table_max_depth, the depth of the last layer, are subdivided.
const MAX_PIECES: f32 = 65536.0;

// Opacity at which integration stops (early termination).
override INTEGRATION_CUTOFF: f32 = 0.9995;

@group(0) @binding(next) var table: texture_2d_array<f32>;
@group(0) @binding(next) var smooth_sampler: sampler;

// Returns the premultiplied colour and opacity of a segment between table coordinates s0 (front)
// and s1. There is only one transfer function, so `row` is ignored.
fn segment(s0: f32, s1: f32, depth: f32, row: u32) -> vec4<f32> {
    let pieces = clamp(ceil(depth / params.table_max_depth), 1.0, MAX_PIECES);
    let layer = clamp(depth / (pieces * params.table_max_depth), 0.0, 1.0) * f32(params.layers - 1u);
    let below = i32(min(layer, f32(params.layers) - 2.0));
    var sum = vec4(0.0);
    for (var i = 0.0; i < pieces && sum.a < INTEGRATION_CUTOFF; i += 1.0) {
        let s = mix(vec2(s0), vec2(s1), vec2(i, i + 1.0) / pieces);
        let shorter = textureSampleLevel(table, smooth_sampler, s, below, 0.0);
        let longer = textureSampleLevel(table, smooth_sampler, s, below + 1, 0.0);
        sum += (1.0 - sum.a) * mix(shorter, longer, layer - f32(below));
    }
    return sum;
}
